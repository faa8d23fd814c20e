"""What an agent may promise about attempts: accept, refuse, repeat and end them. Pure; time comes in with each call.

Every method returns effects that the shell carries out in their order: a `Save` stands before every word or motion that
depends on it, so a crash between two effects can repeat a word but never a motion. Two rules carry the rest:

- an attempt's final word never changes: once refused, ended or declared unknown, a later start of it gets that answer;
- an attempt begins at most once, because `started` is in the journal before `Begin`.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from muster_schemas.robot import RequestAction, SkillRequest, SkillStatus, SkillStatusKind, StatusAck, TaskRef

REPEAT_S = 0.5
"""How often a final status is said again until it is acknowledged."""

PROGRESS_STEPS = 20
"""Progress is told in this many steps; they are not journaled, so a restart skips as many sequence numbers."""

LARGEST_NUMBER = 2**53
"""Larger attempts and epochs are not obeyed: neither every JSON reader nor the journal can hold them."""


@dataclass(frozen=True)
class Attempt:
    """All that is remembered of one attempt."""

    ref: TaskRef
    skill: str
    epoch: int
    state: SkillStatusKind
    seq: int
    deadline: float
    progress: float = 0.0
    reason: str | None = None
    acked: bool = False


@dataclass(frozen=True)
class Save:
    """Commit the attempt and the highest epoch seen."""

    attempt: Attempt
    epoch: int


@dataclass(frozen=True)
class Say:
    """Publish a status."""

    status: SkillStatus


@dataclass(frozen=True)
class Begin:
    """Start the machine on this request: the one physical start of the attempt."""

    request: SkillRequest


@dataclass(frozen=True)
class Halt:
    """Bring the machine to a safe halt and then report the attempt as cancelled."""

    ref: TaskRef


@dataclass(frozen=True)
class Hold:
    """Make the machine hold still until `Continue`, and report when it does."""

    ref: TaskRef


@dataclass(frozen=True)
class Continue:
    """Go on after `Hold`."""

    ref: TaskRef


Effect = Save | Say | Begin | Halt | Hold | Continue


class Core:
    """The agent's book of attempts for one life of one robot."""

    def __init__(
        self, robot_id: str, boot_id: str, skills: Collection[str], *, attempts: Iterable[Attempt] = (), epoch: int = 0
    ) -> None:
        self.robot_id = robot_id
        self.boot_id = boot_id
        self.epoch = epoch
        self.active: TaskRef | None = None
        self._skills = frozenset(skills)
        self._attempts = {a.ref: a for a in attempts}
        self._said_at: dict[TaskRef, float] = {a.ref: 0.0 for a in self._attempts.values() if _owed(a)}
        self._cancelling = False

    def attempt(self, ref: TaskRef) -> Attempt | None:
        """Return what is known of an attempt."""
        return self._attempts.get(ref)

    def recover(self, now: float) -> list[Effect]:
        """Report what an earlier life left under way: the machine stands still, how far it came is not known."""
        effects: list[Effect] = []
        for attempt in [a for a in self._attempts.values() if not a.state.final]:
            begun = attempt.state is not SkillStatusKind.ACCEPTED
            ended = replace(
                attempt,
                state=SkillStatusKind.INTERRUPTED if begun else SkillStatusKind.REFUSED,
                seq=attempt.seq + PROGRESS_STEPS + 1,
                reason=f"the agent restarted {'while this was under way' if begun else 'before this began'}",
            )
            effects += self._keep(ended, now)
        return effects

    def request(self, request: SkillRequest, now: float, hindrance: str | None = None) -> list[Effect]:
        """Handle a request; the same one again changes nothing and gets the same answer.

        Args:
            request: as it came.
            now: wall clock.
            hindrance: why the machine cannot start anything now, if so.

        """
        if request.robot_id != self.robot_id or max(request.attempt, request.epoch) > LARGEST_NUMBER:
            return []
        fenced = request.epoch < self.epoch
        self.epoch = max(self.epoch, request.epoch)
        known = self._attempts.get(request.ref)
        if known is None:
            return self._first_sight(request, now, hindrance, fenced=fenced)
        foreign = fenced or request.boot_id != self.boot_id or request.skill != known.skill
        if request.ref != self.active or foreign or self._cancelling:
            return [Say(self._status(known, now))]
        if known.state is SkillStatusKind.ACCEPTED:
            return self._prepared(request, known, now, hindrance)
        return self._steer(request.action, known, now)

    def _prepared(self, request: SkillRequest, known: Attempt, now: float, hindrance: str | None) -> list[Effect]:
        """Begin with the team, or give up a reservation; the machine has not moved for this attempt."""
        if request.action is RequestAction.CANCEL:
            return self.ended(known.ref, SkillStatusKind.CANCELLED, "it had not begun", now)
        if request.action is not RequestAction.START:
            return [Say(self._status(known, now))]
        refusal = self._too_late(request, now) or hindrance
        if refusal is not None:
            return self.ended(known.ref, SkillStatusKind.REFUSED, refusal, now)
        started = replace(known, state=SkillStatusKind.STARTED, seq=known.seq + 1)
        return [*self._keep(started, now), Begin(request)]

    def _steer(self, action: RequestAction, known: Attempt, now: float) -> list[Effect]:
        """Act on the attempt that is under way."""
        effects: list[Effect] = [Say(self._status(known, now))]
        if action is RequestAction.CANCEL:
            self._cancelling = True
            effects.insert(0, Halt(known.ref))
        elif action is RequestAction.PAUSE and known.state is not SkillStatusKind.PAUSED:
            effects.insert(0, Hold(known.ref))
        elif action is RequestAction.RESUME:
            effects = self._resume(known, now)
        return effects

    def _first_sight(self, request: SkillRequest, now: float, hindrance: str | None, *, fenced: bool) -> list[Effect]:
        fresh = Attempt(
            ref=request.ref,
            skill=request.skill,
            epoch=request.epoch,
            state=SkillStatusKind.UNKNOWN,
            seq=1,
            deadline=request.deadline,
        )
        if request.action not in (RequestAction.START, RequestAction.PREPARE):
            reason = f"asked to {request.action} an attempt that was never seen here; a start of it is now refused"
            return self._keep(replace(fresh, reason=reason), now)
        refusal = self._refusal(request, now, fenced=fenced) or hindrance
        if refusal is not None:
            return self._keep(replace(fresh, state=SkillStatusKind.REFUSED, reason=refusal), now)
        accepted = replace(fresh, state=SkillStatusKind.ACCEPTED)
        if request.action is RequestAction.PREPARE:
            self.active, self._cancelling = request.ref, False
            return self._keep(accepted, now)
        started = replace(fresh, state=SkillStatusKind.STARTED, seq=2)
        self.active, self._cancelling = request.ref, False
        # one commit covers both words: nothing is said or moved before it
        save, say_started = self._keep(started, now)
        return [save, Say(self._status(accepted, now)), say_started, Begin(request)]

    def _refusal(self, request: SkillRequest, now: float, *, fenced: bool) -> str | None:
        if fenced:
            return f"epoch {request.epoch} is over: a scheduler of epoch {self.epoch} has spoken"
        if request.boot_id != self.boot_id:
            return f"meant for an earlier life of this agent ({request.boot_id}); it is now {self.boot_id}"
        late = self._too_late(request, now)
        if late is not None:
            return late
        if request.skill not in self._skills:
            return f"{self.robot_id} has no skill {request.skill}"
        if self.active is not None:
            busy = self.active
            return f"busy with task {busy.task_id} of mission {busy.mission_id}, attempt {busy.attempt}"
        return None

    @staticmethod
    def _too_late(request: SkillRequest, now: float) -> str | None:
        late_s = now - request.deadline
        return f"it came {late_s:.1f} s after its deadline" if late_s > 0 else None

    def _resume(self, known: Attempt, now: float) -> list[Effect]:
        if known.state is not SkillStatusKind.PAUSED:
            # a pause that has not taken effect yet is taken back as well
            return [Continue(known.ref), Say(self._status(known, now))]
        going = replace(known, state=SkillStatusKind.PROGRESS, seq=known.seq + 1)
        return [*self._keep(going, now), Continue(known.ref)]

    def held(self, ref: TaskRef, now: float) -> list[Effect]:
        """Record that the machine holds still, as a pause asked."""
        known = self._attempts.get(ref)
        if known is None or ref != self.active or known.state is SkillStatusKind.PAUSED:
            return []
        return self._keep(replace(known, state=SkillStatusKind.PAUSED, seq=known.seq + 1), now)

    def progressed(self, ref: TaskRef, progress: float, now: float) -> list[Effect]:
        """Tell progress (0 to 1) when it reached a further step."""
        known = self._attempts.get(ref)
        if known is None or ref != self.active or known.state is SkillStatusKind.PAUSED:
            return []
        step = int(min(max(progress, 0.0), 1.0) * PROGRESS_STEPS)
        if step <= int(known.progress * PROGRESS_STEPS + 1e-9):
            return []
        known = replace(
            known, state=SkillStatusKind.PROGRESS, seq=known.seq + 1, progress=step / PROGRESS_STEPS, reason=None
        )
        self._attempts[ref] = known
        return [Say(self._status(known, now))]

    def ended(self, ref: TaskRef, state: SkillStatusKind, reason: str | None, now: float) -> list[Effect]:
        """Record how the active attempt ended; `state` is final."""
        known = self._attempts.get(ref)
        if known is None or ref != self.active or not state.final:
            return []
        self.active, self._cancelling = None, False
        progress = 1.0 if state is SkillStatusKind.SUCCEEDED else known.progress
        reason = reason[:1000] if reason else None
        return self._keep(replace(known, state=state, seq=known.seq + 1, progress=progress, reason=reason), now)

    def acked(self, ack: StatusAck) -> list[Effect]:
        """Stop repeating a final status that the scheduler has in its journal."""
        known = self._attempts.get(TaskRef(mission_id=ack.mission_id, task_id=ack.task_id, attempt=ack.attempt))
        if known is None or ack.robot_id != self.robot_id or not _owed(known) or ack.seq < known.seq:
            return []
        known = replace(known, acked=True)
        self._attempts[known.ref] = known
        self._said_at.pop(known.ref, None)
        return [Save(known, self.epoch)]

    def tick(self, now: float) -> list[Effect]:
        """Say again what is owed."""
        effects: list[Effect] = []
        for ref, said_at in self._said_at.items():
            # a wall clock that was set back must not silence the outbox
            if not 0 <= now - said_at < REPEAT_S:
                self._said_at[ref] = now
                effects.append(Say(self._status(self._attempts[ref], now)))
        return effects

    def _keep(self, attempt: Attempt, now: float) -> list[Effect]:
        self._attempts[attempt.ref] = attempt
        if _owed(attempt):
            self._said_at[attempt.ref] = now
        return [Save(attempt, self.epoch), Say(self._status(attempt, now))]

    def _status(self, attempt: Attempt, now: float) -> SkillStatus:
        return SkillStatus(
            mission_id=attempt.ref.mission_id,
            task_id=attempt.ref.task_id,
            attempt=attempt.ref.attempt,
            epoch=attempt.epoch,
            robot_id=self.robot_id,
            boot_id=self.boot_id,
            skill=attempt.skill,
            seq=attempt.seq,
            state=attempt.state,
            progress=attempt.progress,
            reason=attempt.reason,
            at=now,
        )

    def validate(self) -> None:
        """Check what must always hold; tests call it after every step.

        Raises:
            AssertionError: the book contradicts itself.

        """
        under_way = [a.ref for a in self._attempts.values() if not a.state.final]
        if under_way != ([self.active] if self.active else []):
            raise AssertionError(f"active is {self.active}, but these are under way: {under_way}")
        owed = [a.ref for a in self._attempts.values() if _owed(a)]
        if len(owed) != len(self._said_at) or any(ref not in self._said_at for ref in owed):
            raise AssertionError(f"owed {owed}, but the outbox holds {list(self._said_at)}")


def _owed(attempt: Attempt) -> bool:
    return attempt.state.final and not attempt.acked
