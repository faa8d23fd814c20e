"""The paper's baseline: the model writes a Python program with threads, as SMART-LLM has it, not a plan with a graph.

It stands behind the same port as every planner, so the same gate judges what it plans. The program is parsed, never
run (`threads`).
"""

import re
from collections.abc import Sequence

from muster_schemas.skills import ObjectNeed, Skill

from muster_planner.errors import SetupError, UnusableAnswerError
from muster_planner.llm import PlanDraft, PlanningModel, PlanRequest, TextModel

from .threads import PlanCodeError, read_program

_FENCE = re.compile(r"```(?:python|py)?[ \t]*\n(.*?)(?:```|\Z)", re.DOTALL)
_REFUSAL = re.compile(r"^\s*#?\s*REFUSE:?\s*(.+)$", re.MULTILINE)

_RULES = """\
The program does what the instruction asks for, literally or by plain implication, and nothing else.
- To inspect, check or look at an object is to drive there. To clear an obstacle is to drive there and dig.
- To dig at an object is to drive there first, unless the robot is said to be there. With no place named, only dig.
- To load a truck at a place: digger and truck drive there; the digger digs, then unloads into the truck. DumpLoading of
  the truck is there only if the truck itself is said to load, beside the unloading.
- To haul and tip is that the truck drives there and then unloads. To go home is return_to_start.
- To avoid or keep away is avoid_areas, "safe again" is allow_areas. An object without a number is number 1.
- For the whole fleet call the skill that ends in _for_all_robots, which takes no robots.
Lines run one after another; what may happen at the same time runs in threads, and join() waits for them.
Only these things may stand in the program: skills, functions without conditions, loops over lists,
threading.Thread(target=..., args=...), start(), join(). If the instruction cannot be done with these robots, skills
and objects, answer one line: REFUSE: and why."""

_EXAMPLE = """\
Instruction: {digger} digs at {place} while {mover} drives to {place}; when both are done, {digger} goes home.
```python
import threading

def dig_there():
    target_area_for_specific_robots(["{digger}"], "{place}")
    {work}(["{digger}"], "{place}")

def drive_there():
    target_area_for_specific_robots(["{mover}"], "{place}")

first = threading.Thread(target=dig_there)
second = threading.Thread(target=drive_there)
first.start()
second.start()
first.join()
second.join()
return_to_start_for_specific_robots(["{digger}"])
```"""


class SmartLlm:
    """A planner that asks a text model for programs.

    Raises:
        SetupError: the model writes no free text.

    """

    def __init__(self, model: PlanningModel) -> None:
        if not isinstance(model, TextModel):
            raise SetupError(
                "This model writes plans only, no programs, so it cannot do --method smart-llm. Take a large model, "
                "such as --planner ollama:llama3.1."
            )
        self._model = model

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return a draft; see `llm.PlanningModel`."""
        answer = await self._model.complete(chat(request), timeout_s=request.timeout_s, max_tokens=request.max_tokens)
        said = answer.text
        refusal = _REFUSAL.search(said)
        plan = None
        if not refusal:
            try:
                plan = read_program(program_in(said), request.catalogue)
            except PlanCodeError as error:
                message = f"The model's program is no plan: {error}."
                raise UnusableAnswerError(
                    message[:900], raw=said, tokens_in=answer.tokens_in, tokens_out=answer.tokens_out
                ) from error
        return PlanDraft(
            plan=plan,
            refusal=refusal[1].strip() if refusal else None,
            raw=said,
            latency_s=answer.latency_s,
            tokens_in=answer.tokens_in,
            tokens_out=answer.tokens_out,
        )


def program_in(said: str) -> str:
    """Return the program in an answer: its last block of code, else all of it."""
    blocks = _FENCE.findall(said)
    return str(blocks[-1]) if blocks else said


def chat(request: PlanRequest) -> list[dict[str, str]]:
    """Return the chat: who is where, what can be called, an example, the instruction, and what was wrong before."""
    asked = [
        {"role": "system", "content": _system(request)},
        {"role": "user", "content": f"Instruction: {request.text}"},
    ]
    if request.feedback:
        wrong = "\n".join(f"- {r.message}" for r in request.feedback.reasons)
        asked += [
            {"role": "assistant", "content": request.feedback.raw[:4000] or "(nothing)"},
            {"role": "user", "content": f"That cannot run on this site:\n{wrong}\nAnswer again, corrected."},
        ]
    return asked


def _system(request: PlanRequest) -> str:
    had = {name for card in request.roster for name in card.skills}
    skills = [s for s in request.catalogue if s.name in had or s.fleet_wide]
    parts = [
        "You write Python programs that command a crew of robots. Robots:\n"
        + "\n".join(f'"{c.robot_id}" ({c.type})' for c in request.roster),
        "Objects: " + ", ".join(f'"{o}"' for o in request.objects),
        "Skills (robots: a list of robots' names, or robots_of(type, how many), or robots_of(type) for all of it; "
        "objects: a name or a list of names):\n" + "\n".join(_signature(s) for s in skills),
        _RULES,
        *_example(request, skills),
        "Answer with one block of Python code.",
    ]
    return "\n\n".join(parts)


def _signature(skill: Skill) -> str:
    objects = {ObjectNeed.REQUIRED: ["objects"], ObjectNeed.OPTIONAL: ["objects=[]"], ObjectNeed.NONE: []}
    parameters = [*([] if skill.fleet_wide else ["robots"]), *objects[skill.objects]]
    who = f" ({', '.join(skill.robot_types)} only)" if skill.robot_types else ""
    return f"{skill.aliases[0] if skill.aliases else skill.name}({', '.join(parameters)})  # {skill.text}{who}"


def _example(request: PlanRequest, skills: Sequence[Skill]) -> list[str]:
    """Return one worked example about this site's own robots; none where there is nobody who digs."""
    dig = next((s for s in skills if s.verb == "dig"), None)
    digger = next((c for c in request.roster if dig and dig.name in c.skills), None)
    mover = next((c for c in request.roster if digger and c.robot_id != digger.robot_id), None)
    if not (dig and digger and mover and request.objects):
        return []
    work = dig.aliases[0] if dig.aliases else dig.name
    return [_EXAMPLE.format(digger=digger.robot_id, mover=mover.robot_id, place=request.objects[0], work=work)]
