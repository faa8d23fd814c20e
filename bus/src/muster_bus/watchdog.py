"""Ends a process whose event loop stands still: its token would say "alive" for ever, as Zenoh has its own threads."""

import asyncio
import contextlib
import faulthandler
import os
import sys
import threading
from collections.abc import AsyncGenerator
from typing import Final

STALLED_EXIT: Final = 70
"""Exit code of a process whose loop stood still (EX_SOFTWARE)."""

_CHECKS = 10
"""Checks within one limit. Counted instead of timed, so that a process that was stopped and continued is not ended."""


@contextlib.asynccontextmanager
async def watch_loop(limit_s: float) -> AsyncGenerator[None]:
    """End the process, with all stacks on stderr, once the loop has not run for `limit_s` seconds."""
    every_s = limit_s / _CHECKS
    beat, ended = threading.Event(), threading.Event()

    async def beats() -> None:
        while True:
            beat.set()
            await asyncio.sleep(every_s / 2)

    def check() -> None:
        missed = 0
        while not ended.wait(every_s):
            missed = 0 if beat.is_set() else missed + 1
            beat.clear()
            if missed >= _CHECKS:
                sys.stderr.write(f"the event loop has stood still for {limit_s:g} s; ending the process\n")
                faulthandler.dump_traceback(file=sys.stderr)
                sys.stderr.flush()
                os._exit(STALLED_EXIT)

    beating = asyncio.create_task(beats(), name="watchdog")
    threading.Thread(target=check, name="watchdog", daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        beating.cancel()
