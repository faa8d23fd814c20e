"""What goes wrong at the command line: one clear line that says what to do, and an exit code."""


class CliError(Exception):
    """Shown to the operator as it is, without a traceback."""

    def __init__(self, message: str, exit_code: int = 1) -> None:
        super().__init__(message)
        self.exit_code = exit_code
