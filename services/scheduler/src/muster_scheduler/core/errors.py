"""What the core says to a caller who asks for what cannot be."""

from muster_schemas.rpc import ErrorCode


class NotPossibleError(Exception):
    """A caller asks for what cannot be; nothing has changed."""

    def __init__(self, code: ErrorCode, message: str) -> None:
        self.code = code
        super().__init__(message)
