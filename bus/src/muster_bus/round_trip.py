"""What the wire itself costs: raw Zenoh puts to an echo in another process and back, through a router.

For measurements that compare a service with this floor. `python -m muster_bus.round_trip ENDPOINT` is the echo.
"""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import queue
import subprocess
import sys
import threading
import time

import zenoh

from .session import client_config

_THERE, _BACK = "round_trip/there", "round_trip/back"
_START_S = 60.0


def round_trips(endpoint: str, count: int, size: int) -> list[float]:
    """Return the seconds of `count` round trips of `size` bytes, one after the other, through the router.

    Raises:
        TimeoutError: the echo does not answer.

    """
    echo = subprocess.Popen([sys.executable, "-m", __name__, endpoint])  # noqa: S603  (this very module)
    back: queue.SimpleQueue[float] = queue.SimpleQueue()
    session = zenoh.open(client_config([endpoint]))
    try:

        def arrived(_: zenoh.Sample) -> None:
            back.put(time.perf_counter())

        session.declare_subscriber(_BACK, zenoh.handlers.Callback(arrived, indirect=False))
        payload = b"x" * size
        _wait_for_echo(session, back)
        seconds: list[float] = []
        for _ in range(count):
            begun = time.perf_counter()
            session.put(_THERE, payload, congestion_control=zenoh.CongestionControl.BLOCK)
            seconds.append(back.get(timeout=_START_S) - begun)
        return seconds
    except queue.Empty:
        raise TimeoutError("the echo does not answer") from None
    finally:
        session.close()
        echo.kill()
        echo.wait()


def _wait_for_echo(session: zenoh.Session, back: "queue.SimpleQueue[float]") -> None:
    give_up = time.monotonic() + _START_S
    while True:
        session.put(_THERE, b"")
        try:
            back.get(timeout=0.1)
        except queue.Empty:
            if time.monotonic() > give_up:
                raise
            continue
        break
    while True:  # answers to what was sent while the echo was starting
        try:
            back.get(timeout=0.2)
        except queue.Empty:
            return


def _echo(endpoint: str) -> None:
    with zenoh.open(client_config([endpoint])) as session:

        def answer(sample: zenoh.Sample) -> None:
            session.put(_BACK, sample.payload, congestion_control=zenoh.CongestionControl.BLOCK)

        session.declare_subscriber(_THERE, zenoh.handlers.Callback(answer, indirect=False))
        threading.Event().wait()


if __name__ == "__main__":
    _echo(sys.argv[1])
