"""Bad input, which every command refuses alike."""


def refusal(capsys, main, *argv):
    """Give a command bad input; return the one line that it says, with exit code 2."""
    try:
        code = main([str(word) for word in argv])
    except SystemExit as stop:
        code = stop.code
    error = capsys.readouterr().err
    assert code == 2
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    return error
