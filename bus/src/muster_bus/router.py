"""The router of the embedded default: `python -m muster_bus.router`. Containers use `zenohd` in its place."""

import signal
import sys
from typing import NoReturn

import structlog
import zenoh

from . import logs
from .session import router_config
from .settings import RouterSettings, is_loopback, read

_log = structlog.stdlib.get_logger(__name__)

CANNOT_LISTEN_EXIT = 69
"""Exit code when the endpoint is taken or wrong (EX_UNAVAILABLE)."""


def main() -> NoReturn:
    """Route until SIGTERM or SIGINT."""
    settings = read(RouterSettings)
    logs.set_up(settings.log_level, service="router")
    ends = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)  # before Zenoh's threads, which inherit it
    try:
        session = zenoh.open(router_config(settings.listen))
    except zenoh.ZError as error:
        where = ", ".join(settings.listen)
        sys.stderr.write(f"router: cannot listen on {where}; is another router running? ({str(error)[:300]})\n")
        sys.exit(CANNOT_LISTEN_EXIT)
    with session:
        _log.info("alive", listen=list(settings.listen))
        beyond = [e for e in settings.listen if not is_loopback(e)]
        if beyond:
            _log.warning("open_to_the_network", listen=beyond, risk="whoever reaches it can command the robots")
        number = signal.sigwait(ends)
        _log.info("stopping", signal=signal.Signals(number).name)
    sys.exit(0)


if __name__ == "__main__":
    main()
