"""The pure heart of the scheduler: `Core.handle(event) -> list[Effect]`; no I/O, no clock, no randomness."""
