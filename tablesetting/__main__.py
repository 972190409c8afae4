"""The command line; Ctrl-C is no error from the first import on."""

import sys


def main() -> int:
    """Run one command and return its exit code."""
    try:
        from tablesetting import cli

        return cli.main()
    except (KeyboardInterrupt, ImportError) as error:
        if not _is_interruption(error):
            raise
        print("interrupted", file=sys.stderr)
        return 130


def _is_interruption(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C is behind an error: compiled modules fail to import then."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error is not None
    return _is_interruption(error.__cause__ or error.__context__)


if __name__ == "__main__":
    sys.exit(main())
