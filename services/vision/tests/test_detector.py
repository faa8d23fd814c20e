"""From rendered pictures to sightings."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from muster_schemas.site import Site, Thing
from muster_sim.world import World
from muster_vision.birdseye import BirdsEye
from muster_vision.camera import Picture
from muster_vision.clip_model import ClipModel, Scores
from muster_vision.detector import Detector
from muster_vision.object_map import message
from muster_vision.outline import Shape, shape
from muster_vision.overlay import overlay
from muster_vision.robots import Shadows, Stand, shadows
from muster_vision.tracker import Place, Sighting, Track
from muster_vision.vocabulary import Wishes

Film = Callable[..., BirdsEye]
NOBODY: tuple[Stand, ...] = ()


@pytest.fixture
def world(yard: Site) -> Iterator[World]:
    """Provide the default site as it begins."""
    with World(yard) as made:
        yield made


@pytest.fixture
def detector(model: ClipModel, yard: Site) -> Detector:
    """Provide a detector that has seen nothing yet."""
    return Detector(model, flat=yard.vision.flat, loose=yard.vision.loose)


def look(detector: Detector, view: BirdsEye, site: Site, stands: tuple[Stand, ...] = NOBODY) -> list[Sighting]:
    """Return what is recognised when asked for the site's classes."""
    return detector.look(view, Wishes(site).vocabulary(0.0), shadows(view, stands))


def stands_of(world: World) -> tuple[Stand, ...]:
    """Return where the machines of a world are."""
    return tuple(Stand(m.x, m.y, m.yaw, m.kind) for m in world.machines.values())


def nearest(sightings: list[Sighting], thing: Thing) -> float:
    """Return the distance to the nearest sighting of a thing's class, in metres."""
    at = (thing.position.x, thing.position.y)
    return min((math.dist(s.position, at) for s in sightings if s.object_class == thing.object_class), default=math.inf)


def film_of(site: Site, film: Film) -> BirdsEye:
    """Return the view of a site as it begins."""
    with World(site) as world:
        return film(world)


def film_of_again(site: Site, film: Film, view: BirdsEye) -> BirdsEye:
    """Return the view after the cameras showed this site."""
    with World(site) as world:
        return film(world, 101.0, view)


def pile(view: BirdsEye, x: float, y: float) -> Shape:
    """Return a round shape of 2 m radius."""
    turns = np.linspace(0, 2 * math.pi, 20)
    window = view.grid.around(np.array([[x, y]]), 3.0)
    mask = view.grid.paint(np.array([x, y]) + 2.0 * np.column_stack([np.cos(turns), np.sin(turns)]))
    found = shape(mask[window.cells], window, view.grid)
    assert found is not None
    return found


def without(site: Site, *names: str) -> Site:
    """Return a site without some of its things."""
    return site.model_copy(update={"things": tuple(t for t in site.things if t.name not in names)})


@pytest.mark.parametrize("robots_known", [True, False])
def test_everything_in_the_default_yard_is_named_where_it_is(
    detector: Detector, world: World, yard: Site, film: Film, *, robots_known: bool
) -> None:
    """All seven, none twice, no machine among them, whether or not robots say where they are."""
    sightings = look(detector, film(world), yard, stands_of(world) if robots_known else NOBODY)
    assert len(sightings) == len(yard.things) == 7
    for thing in yard.things:
        assert nearest(sightings, thing) < 0.25
        (found,) = [s for s in sightings if math.dist(s.position, (thing.position.x, thing.position.y)) < 1.0]
        assert found.whole
        assert 0.5 * thing.radius_m < found.radius_m < 1.1 * thing.radius_m


@pytest.mark.parametrize("seed", [101, 102, 103])
def test_a_yard_of_other_looks_reads_the_same(detector: Detector, yard: Site, film: Film, seed: int) -> None:
    """Ground, shapes and colours of seeds that training never saw."""
    with World(yard, seed=seed) as other:
        sightings = look(detector, film(other), yard)
    assert len(sightings) == 7
    assert all(nearest(sightings, thing) < 0.25 for thing in yard.things)


def test_what_stands_up_is_where_it_touches_the_ground_though_seen_from_the_side(
    detector: Detector, yard: Site, film: Film
) -> None:
    """A block 2 m high that two cameras see leaning by a metre in different directions."""
    thing = yard.things[4]
    tall = thing.model_copy(update={"height_m": 2.0})
    site = yard.model_copy(update={"things": (tall,), "robots": yard.robots[:1]})
    with World(site) as world:
        (found,) = look(detector, film(world), site)
    assert math.dist(found.position, (thing.position.x, thing.position.y)) < 0.25


def test_an_unchanged_view_is_not_searched_again(
    detector: Detector, world: World, yard: Site, film: Film, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second look costs a comparison; a change in one corner leaves the rest alone."""
    view = film(world)
    first = look(detector, view, yard)
    asked: list[int] = []
    scores = ClipModel.scores

    def counted(model: ClipModel, crops: list[Picture], wordings: Sequence[Sequence[str]]) -> Scores:
        asked.append(len(crops))
        return scores(model, crops, wordings)

    monkeypatch.setattr(ClipModel, "scores", counted)
    assert look(detector, film(world, 101.0, view), yard) == [replace(s, seen_at=101.0) for s in first]
    assert asked == []
    with World(without(yard, "rock1")) as changed:
        second = look(detector, film(changed, 102.0, view), yard)
    assert {s.object_class for s in first} - {s.object_class for s in second} == {"rock"}
    assert sum(asked) <= 3


def test_the_place_of_a_thing_that_was_taken_away_is_bare(
    detector: Detector, world: World, yard: Site, film: Film
) -> None:
    """Seen to be so by the cameras."""
    view = film(world)
    (rock,) = [s for s in look(detector, view, yard) if s.object_class == "rock"]
    with World(without(yard, "rock1")) as changed:
        look(detector, film(changed, 101.0, view), yard)
    assert detector.judge(view, shadows(view, NOBODY), Track(rock)) is Place.BARE


def test_a_thing_under_a_robot_is_hidden(detector: Detector, world: World, yard: Site, film: Film) -> None:
    """Nothing speaks against it then."""
    view = film(world)
    (rock,) = [s for s in look(detector, view, yard) if s.object_class == "rock"]
    above = Stand(rock.position[0], rock.position[1], 0.0, yard.robot_types["dump_truck"])
    assert detector.judge(view, shadows(view, (above,)), Track(rock)) is Place.HIDDEN


def test_a_heap_that_lay_behind_a_robot_is_found_when_the_robot_says_that_it_has_left(
    detector: Detector, yard: Site, film: Film
) -> None:
    """The picture had shown it before, and does not change any more."""
    view = film_of(without(yard, "soil1"), film)
    look(detector, view, yard)
    view = film_of_again(yard, film, view)
    beside = Stand(-10.0, 12.0, 0.0, yard.robot_types["dump_truck"])
    assert nearest(look(detector, view, yard, (beside,)), yard.things[0]) > 1.0
    away = Stand(0.0, -20.0, 0.0, yard.robot_types["dump_truck"])
    assert nearest(look(detector, view, yard, (away,)), yard.things[0]) < 0.25


def test_a_pile_is_measured_when_the_excavator_beside_it_has_left(detector: Detector, yard: Site, film: Film) -> None:
    """Though the picture of the pile itself is the same."""
    view = film_of(yard, film)
    beside = Stand(-15.5, 12.0, 0.0, yard.robot_types["excavator"])
    away = Stand(-28.0, -20.0, 0.0, yard.robot_types["excavator"])
    for stand, whole in ((beside, False), (away, True)):
        sightings = look(detector, view, yard, (stand,))
        assert [s.whole for s in sightings if math.dist(s.position, (-10, 12)) < 1.0] == [whole]


def test_a_thing_covered_by_another_is_neither_bare_nor_hidden(detector: Detector, yard: Site, film: Film) -> None:
    """A heap as large as the puddle was tipped onto it."""
    view = film_of(yard, film)
    (puddle,) = [s for s in look(detector, view, yard) if s.object_class == "puddle" and s.position[0] < 0]
    heap = {"name": "heap", "class": "soil", "position": {"x": -9, "y": -12}, "radius_m": 2.4, "height_m": 1.4}
    buried = yard.model_copy(update={"things": (*yard.things, Thing.model_validate(heap))})
    with World(buried) as world:
        look(detector, film(world, 101.0, view), yard)
    assert detector.judge(view, shadows(view, NOBODY), Track(puddle)) is Place.UNCLEAR


@pytest.mark.parametrize("at", [(-9.0, -12.0), (-8.0, -12.5)])
def test_a_load_tipped_onto_a_puddle_is_a_heap_on_a_puddle(
    detector: Detector, yard: Site, film: Film, at: tuple[float, float]
) -> None:
    """One cubic metre: both are seen, each where it is."""
    heap = {"name": "heap", "class": "soil", "position": {"x": at[0], "y": at[1]}, "radius_m": 1.02, "height_m": 0.61}
    site = yard.model_copy(update={"things": (*yard.things, Thing.model_validate(heap))})
    sightings = look(detector, film_of(site, film), site)
    assert nearest(sightings, site.things[-1]) < 0.35
    (puddle,) = [t for t in site.things if t.name == "puddle1"]
    assert nearest(sightings, puddle) < 0.35


def test_a_small_spill_is_no_object(detector: Detector, yard: Site, film: Film) -> None:
    """A bucket that leaks leaves a few hand's breadths of soil."""
    spill = {"name": "spill", "class": "soil", "position": {"x": 2, "y": 8}, "radius_m": 0.5, "height_m": 0.3}
    site = yard.model_copy(update={"things": (*yard.things, Thing.model_validate(spill))})
    sightings = look(detector, film_of(site, film), site)
    assert not [s for s in sightings if math.dist(s.position, (2, 8)) < 1.5]


def test_an_arm_in_reach_means_that_a_pile_may_be_seen_in_part(yard: Site, film: Film) -> None:
    """Its geometry is not to be believed then; that of a pile far from all arms is."""
    view = film_of(yard, film)
    stand = Stand(-14.0, 12.0, 0.0, yard.robot_types["excavator"])
    hidden: Shadows = shadows(view, (stand,))
    near, far = pile(view, -10.0, 12.0), pile(view, 14.0, 13.0)
    assert hidden.may_cover(near)
    assert not hidden.may_cover(far)


def test_outlines_can_be_drawn_for_people(detector: Detector, world: World, yard: Site, film: Film) -> None:
    """The picture in the documents is made by this."""
    view = film(world)
    tracks = [Track(s, name=f"{s.object_class}{i}") for i, s in enumerate(look(detector, view, yard))]
    drawn = overlay(view.picture, view.grid, [message(t) for t in tracks], zoom=2)
    assert drawn.shape == (view.grid.rows * 2, view.grid.columns * 2, 3)
    plain = overlay(view.picture, view.grid, [], zoom=2)
    assert 500 < (drawn != plain).any(axis=2).sum() < 40_000
