"""What the wire itself costs: raw Zenoh puts, and when they arrive. For measurements that compare a service with it.

`python -m muster_bus.round_trip ENDPOINT` is the echo at the other end of a round trip.
"""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import contextlib
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from typing import Self

import zenoh

from .session import client_config
from .wire import JSON

_THERE, _BACK = "round_trip/there", "round_trip/back"
_START_S = 60.0

Arrivals = queue.SimpleQueue[tuple[float, bytes]]
"""(`time.perf_counter()` on Zenoh's own thread, payload) of each sample."""


class Wire:
    """A raw session; a context manager. Samples of its own puts would not pass the router: hear them with another."""

    def __init__(self, endpoint: str) -> None:
        self._session = zenoh.open(client_config([endpoint]))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def hear(self, key: str) -> Arrivals:
        """Note what arrives on a key expression from now on."""
        arrivals: Arrivals = queue.SimpleQueue()

        def arrived(sample: zenoh.Sample) -> None:
            arrivals.put((time.perf_counter(), sample.payload.to_bytes()))

        self._session.declare_subscriber(key, zenoh.handlers.Callback(arrived, indirect=False))
        return arrivals

    def put(self, key: str, payload: bytes) -> float:
        """Send; return the time just before."""
        begun = time.perf_counter()
        self._session.put(key, payload, encoding=JSON, congestion_control=zenoh.CongestionControl.BLOCK)
        return begun


@contextlib.contextmanager
def echoing(endpoint: str) -> Generator[Callable[[int], float]]:
    """Run an echo in another process; yield what makes a round trip of so many bytes and returns its seconds.

    Raises:
        TimeoutError: the echo does not answer.

    """
    echo = subprocess.Popen([sys.executable, "-m", __name__, endpoint])  # noqa: S603  (this very module)
    try:
        with Wire(endpoint) as wire:
            back = wire.hear(_BACK)

            def trip(size: int) -> float:
                begun = wire.put(_THERE, b"x" * size)
                try:
                    return back.get(timeout=_START_S)[0] - begun
                except queue.Empty:
                    raise TimeoutError("the echo does not answer") from None

            _wait_for_echo(wire, back)
            yield trip
    finally:
        echo.kill()
        echo.wait()


def _wait_for_echo(wire: Wire, back: Arrivals) -> None:
    give_up = time.monotonic() + _START_S
    while True:
        wire.put(_THERE, b"")
        try:
            back.get(timeout=0.1)
        except queue.Empty:
            if time.monotonic() > give_up:
                raise TimeoutError("the echo does not answer") from None
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
