"""The command line; Ctrl-C is no error from the first import on."""

import sys

from tablesetting.errors import is_interruption


def main() -> int:
    """Run one command and return its exit code."""
    try:
        from gridworld_bench import cli

        return cli.main()
    except (KeyboardInterrupt, ImportError, SystemError) as error:
        if not is_interruption(error):
            raise
        print("interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
