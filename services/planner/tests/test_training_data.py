"""What the model is trained on says the same as the service does, and means what it says."""

import importlib.util
import random
import sys
from pathlib import Path
from typing import Any

import pytest
from muster_planner.embedded import scene_of
from muster_planner.evaluation.cases import read_cases
from muster_planner.evaluation.fleet import Fleet
from muster_planner.evaluation.scoring import score
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site

PLANNER = Path(__file__).resolve().parents[1]
YARD = Surroundings.of_file(load_site(PLANNER.parents[1] / "sites" / "yard.yaml"))
NAMES = SiteNames(YARD.roster, YARD.objects, YARD.catalogue, YARD.letters)


def training(module: str) -> Any:
    """Import a module of the training code, which is no installed package, under a name of its own."""
    package = "planner_training"
    if package not in sys.modules:
        folder = PLANNER / "training"
        spec = importlib.util.spec_from_file_location(
            package, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        assert spec
        assert spec.loader
        loaded = importlib.util.module_from_spec(spec)
        sys.modules[package] = loaded
        spec.loader.exec_module(loaded)
    return importlib.import_module(f"{package}.{module}")


def test_training_and_service_see_the_same_site() -> None:
    """The model meets in service exactly what it was trained on."""
    sites, batches = training("sites"), training("batches")
    assert batches.scene_of(sites.YARD) == scene_of(NAMES)


def test_steps_are_taught_after_what_they_wait_for() -> None:
    """References to later steps are turned round; implied dependencies go."""
    notation = training("notation")
    taught = notation.parse("1 home E2 < 2 3 | 2 go E2 @ rock1 | 3 dig E2 @ rock1 < 2")
    assert [(s.verb, sorted(s.before)) for s in taught] == [("go", []), ("dig", [0]), ("home", [1])]


def test_every_corpus_line_can_be_taught() -> None:
    """Each line is read, and means the same after it is put in teaching order."""
    corpus, notation = training("corpus"), training("notation")
    cases = corpus.training() + corpus.held_out()
    assert len(cases) > 2500
    for case in cases:
        if not isinstance(case.answer, notation.Refusal):
            assert all(b < n for n, s in enumerate(case.answer) for b in s.before), case.text


@pytest.mark.parametrize("name", ["development.jsonl", "data/voice1.jsonl", "data/voice16.jsonl"])
def test_the_measure_reads_what_is_written_here(name: str) -> None:
    """Each line is a case of `muster evaluate`, and its own plan is right."""
    fleet = Fleet.of(YARD.roster)
    for case in read_cases(PLANNER / "training" / name, YARD):
        assert case.refuse or score(case, case.reference, fleet, YARD.catalogue).right, case.text


def test_variations_stay_on_their_site() -> None:
    """Whatever is changed about a case, its answer names only robots and objects of its site."""
    corpus, augment, notation = training("corpus"), training("augment"), training("notation")
    random_ = random.Random(4)
    cases = corpus.training()
    for case in (augment.varied(random_.choice(cases), random_, 0.0) for _ in range(1500)):
        if isinstance(case.answer, notation.Refusal):
            continue
        robots = {f"{k.letter}{n}" for k in case.site.kinds for n in k.numbers}
        for step in case.answer:
            assert set(step.objects) <= set(case.site.objects), case
            assert all(r in robots or r == "all" or r[1:2] in "*:" for r in step.robots), case


def test_robots_change_places_in_text_and_plan_together() -> None:
    """A permuted case tells the permuted robots to do the same."""
    augment, notation = training("augment"), training("notation")
    case = augment.Case("EX1 and truck no. 3 to the second puddle; digger one digs.", notation.parse(
        "1 go E1 T3 @ puddle2 | 2 dig E1 @ puddle2 < 1"))  # fmt: skip
    changed = augment.permuted(case, random.Random(1), {"E": (3, 1, 2), "T": (1, 3, 2)})
    assert changed.text.startswith("EX3 and truck no. 2 to the ")
    assert changed.text.endswith("digger three digs.")
    assert changed.answer[0].robots == ("E3", "T2")


@pytest.mark.parametrize("text", ["Send 3 to the rock.", "When 2 is done, 3 digs."])
def test_a_text_that_is_not_understood_is_left_alone(text: str) -> None:
    """A bare number could be anything, so nothing is exchanged."""
    assert training("mentions").find(text) is None


def test_the_generator_is_seeded_and_composes_valid_missions() -> None:
    """Equal seeds make equal cases; every case names only what its site has, and refusals are about a tenth."""
    generator, notation = training("generator"), training("notation")
    made = [[generator.mission(random_) for _ in range(400)] for random_ in (random.Random(7), random.Random(7))]
    assert made[0] == made[1]
    refused = sum(isinstance(c.answer, notation.Refusal) for c in made[0])
    assert 20 <= refused <= 80
    for case in made[0]:
        if not isinstance(case.answer, notation.Refusal):
            assert case.answer
            assert all(set(s.objects) <= set(case.site.objects) for s in case.answer), case.text
            assert all(b < n for n, s in enumerate(case.answer) for b in s.before), case.text
