"""The shortest troubles that show each broken rule of `mutants`: what a seed needs luck for, aimed at."""

from typing import Final

from muster_scheduler.testing import planned
from muster_schemas.rpc import MissionAction

from .script import Control, Cut, Foreign, Kill, Script, Submit

E1, T1 = "robot_excavator_01", "robot_dump_truck_01"
DIG, TIP, AVOID = "Excavation", "DumpUnloading", "avoid_areas_for_specific_robots"

_DIG: Final = Submit(5.0, 0, (planned("dig", DIG, [E1]),))
_AGAIN: Final = Submit(14.0, 1, (planned("dig", DIG, [E1]),))
_TEAM: Final = Submit(5.0, 0, (planned("go", "target_area_for_specific_robots", [E1, T1], objects=["rock1"]),))
_JOIN: Final = Submit(
    5.0, 0, (planned("dig", DIG, [E1]), planned("tip", TIP, [T1]), planned("on", TIP, [T1], after=["dig", "tip"]))
)
_RULE: Final = Submit(5.0, 0, (planned("keep out", AVOID, [E1], objects=["rock1"]),))

_MUTE_AT_BEGIN: Final = Kill(5.0, E1, 1, 0.5, place="begun", loses_words=True)
_DEAF: Final = Cut(4.9, 1.0, E1, out=False, into=True, held=False, noticed=False)
_DUMB: Final = Cut(5.1, 6.0, E1, out=True, into=False, held=False, noticed=False)
_SLOW: Final = Cut(4.9, 1.8, E1, out=False, into=True, held=True, noticed=False)

AIMED: Final[dict[str, tuple[Script, ...]]] = {
    "scheduler_sends_before_it_commits": ((_DIG, Kill(5.0, "scheduler", 1, 0.5, place="commit")),),
    "scheduler_acknowledges_before_it_commits": tuple(
        (_DIG, Kill(5.0, "scheduler", n, 0.5, place="commit")) for n in range(2, 7)
    ),
    "agent_does_not_journal_started": ((_DIG, _MUTE_AT_BEGIN),),
    "agent_moves_before_it_journals": ((_DIG, _MUTE_AT_BEGIN),),
    "agent_takes_a_repetition_for_new": ((_DIG, Foreign(13.0, "the last starts again", 0.0, E1)),),
    "agent_does_not_check_the_epoch": (
        (_DIG, Kill(6.0, "scheduler", 1, 0.5), _AGAIN, Foreign(22.0, "a start by a former scheduler", 0.99, E1)),
    ),
    "agent_does_not_check_the_life": ((_DIG, Foreign(20.0, "a start for another life", 0.0, E1)),),
    "agent_does_not_check_the_deadline": ((_DIG, Foreign(20.0, "a start that is too late", 0.0, E1)),),
    "agent_does_not_report_an_interruption": ((_DIG, Kill(5.0, E1, 1, 0.5, place="begun")),),
    "agent_says_its_final_word_once": ((_DIG, _DUMB),),
    "scheduler_asks_once": ((_DEAF, _DIG),),
    "scheduler_believes_late_words": ((_DIG, Foreign(5.1, "a word of a former life", 0.0, E1)),),
    "scheduler_takes_one_for_the_team": ((_TEAM,),),
    "scheduler_takes_one_dependency_for_all": ((_JOIN,),),
    "scheduler_promises_a_stop": ((_SLOW, _DIG, Control(5.2, 0, MissionAction.CANCEL)),),
    "scheduler_knows_what_its_journal_does_not": ((_RULE,),),
}
"""The scripts of which at least one shows it, by the name of the mutant; each list of steps is in order of time."""
