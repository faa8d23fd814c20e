"""The baseline that writes programs, over a real client and server."""

from collections.abc import Generator

import pytest
from muster_planner.errors import SetupError
from muster_planner.evaluation.smart_llm import SmartLlm, program_in
from muster_planner.evaluation.testing import NAMES, case_of, scored
from muster_planner.offline import open_offline
from muster_planner.plan_language import encode
from muster_planner.testing import DRIVE, YARD, FunctionModel
from muster_planner.testing_servers import ModelServer, model_server, says

PROGRAM = """\
Here is the plan:
```python
import threading
one = threading.Thread(target=target_area_for_specific_robots, args=(["robot_excavator_01"], "soil1"))
one.start()
return_to_start_for_specific_robots(["robot_dump_truck_01"])
one.join()
```
I hope this helps."""


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Generator[ModelServer]:
    """Provide an Ollama server where `OLLAMA_HOST` says."""
    with model_server() as running:
        monkeypatch.setenv("OLLAMA_HOST", running.url)
        yield running


def test_a_program_becomes_a_plan(server: ModelServer) -> None:
    """The model is told robots, objects and skills, and held to no JSON form."""
    server.answers = [says(PROGRAM)]
    with open_offline(YARD, "ollama:llama3.1", wrap=SmartLlm) as planner:
        line = planner.plan("E1 to the soil, meanwhile T1 home")
    assert line.plan
    assert encode(line.plan, NAMES).splitlines() == ["a go E1 @ soil1", "b home T1"]
    assert scored(case_of("a go E1 @ soil1", "b home T1"), *encode(line.plan, NAMES).splitlines()).right
    [asked] = server.requests
    system = asked["messages"][0]["content"]
    assert all(r.id in system for r in YARD.robots)
    assert "Excavation(robots, objects=[])" in system
    assert "avoid_areas_for_all_robots(objects)" in system
    assert not asked.get("format")


def test_what_is_no_program_goes_back_with_the_reason(server: ModelServer) -> None:
    """As for every planner, at most twice; then there is no plan."""
    server.answers = [says("while True: pass"), says(PROGRAM)]
    with open_offline(YARD, "ollama:llama3.1", wrap=SmartLlm) as planner:
        assert planner.plan("go").plan
    assert "a plan has no while" in server.requests[1]["messages"][-1]["content"]


def test_a_refusal_is_a_refusal(server: ModelServer) -> None:
    """Not a program that cannot be read."""
    server.answers = [says("# REFUSE: there is no crane")]
    with open_offline(YARD, "ollama:llama3.1", wrap=SmartLlm) as planner:
        line = planner.plan("hoist")
    assert (line.plan, line.error, line.failure) == (None, "there is no crane", None)


def test_a_model_that_writes_no_text_says_so() -> None:
    """Before anything is asked."""
    with pytest.raises(SetupError, match="--planner ollama"):
        SmartLlm(FunctionModel(lambda _: DRIVE))


@pytest.mark.parametrize(
    ("said", "program"),
    [
        ("a()", "a()"),
        ("```python\na()\n```", "a()\n"),
        ("```\na()\n``` then\n```py\nb()\n```", "b()\n"),
        ("```python\na()", "a()"),
    ],
)
def test_the_program_is_the_last_block_of_code(said: str, program: str) -> None:
    """Or all of the answer."""
    assert program_in(said) == program
