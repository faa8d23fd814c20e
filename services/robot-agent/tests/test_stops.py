"""Stops at the robot: which order counts, and what a stop means for a cancel."""

from muster_bus.testing import SITE_FILE
from muster_robot_agent.stops import StopBook
from muster_robot_agent.testing import Crew
from muster_schemas.robot import SkillStatusKind
from muster_schemas.site import load_site
from muster_schemas.stops import StopRequest

T1 = "robot_dump_truck_01"


def test_only_a_higher_number_is_news() -> None:
    """A late stop after its release, or the same one again, changes nothing."""
    stop, release = (
        StopRequest(robot_id=T1, number=n, stopped=s, issued_at=0.0) for n, s in ((5, True), (6, False))
    )  # fmt: skip
    book = StopBook().after(stop, busy=True)
    assert (book.stopped, book.was_busy) == (True, True)
    released = book.after(release, busy=True)
    assert not released.stopped
    assert released.after(stop, busy=False) is released
    assert StopBook.kept(released.kept_number) == StopBook(6, stopped=False)
    assert StopBook.kept(book.kept_number) == StopBook(5, stopped=True)
    assert StopBook.kept(None) == StopBook()


def test_a_cancel_of_a_stopped_robot_ends_without_any_motion() -> None:
    """It is not brought into a better rest: whoever stopped it wants it to stand."""
    yard = Crew(load_site(SITE_FILE), [T1])
    run = yard.drive(T1, 20, -15)
    yard.wait(6)
    machine = yard.machines[T1]
    while run.outcome is None:
        yard.world.advance()
        yard.world.command(T1, run.step(yard.world.telemetry(T1), suspended=True))
        if run.holds and machine.still:
            run.cancel()
    assert run.outcome.state is SkillStatusKind.CANCELLED
    assert machine.still
