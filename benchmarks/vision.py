"""How fast and how exactly vision maps: a frame never seen before, and the default site under looks of many seeds."""

import math
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from muster_schemas.site import Site, load_site
from muster_sim.camera import pinhole
from muster_sim.service import jpeg
from muster_sim.world import World
from muster_vision.clip_model import ClipModel
from muster_vision.object_map import message
from muster_vision.pipeline import Frame, Pipeline
from muster_vision.robots import Stand
from muster_vision.tracker import CONFIRM_LOOKS, Tracker
from muster_vision.vocabulary import Wishes

SITE_FILE = Path(__file__).parents[1] / "sites" / "yard.yaml"
SEEDS = range(201, 209)
FRAMES = 5
BAR_S, BAR_M = 0.5, 0.25


def measure() -> Iterator[dict[str, Any]]:
    """Return the time from a 1024 x 1024 frame to messages, and how far and how completely objects are found."""
    cv2.setNumThreads(1)
    site = load_site(SITE_FILE)
    model = ClipModel()
    spent = statistics.median(_frame_to_map_s(site, model, seed) for seed in range(FRAMES))
    yield {"name": "frame_to_map_s", "value": round(spent, 3), "unit": "s", "bar": BAR_S, "ok": spent <= BAR_S}
    errors, found, asked = _accuracy(site, model)
    p95 = float(np.percentile(errors, 95))
    yield {"name": "position_error_p95_m", "value": round(p95, 3), "unit": "m", "bar": BAR_M, "ok": p95 <= BAR_M}
    recall = found / asked
    yield {"name": "vision_recall", "value": round(recall, 4), "unit": "", "bar": 1.0, "ok": recall >= 1.0}


def _frame_to_map_s(site: Site, model: ClipModel, seed: int) -> float:
    """Return the time for a frame that shows the whole yard and in which everything is new."""
    above = {"id": "uav", "position": {"x": 0, "y": 0}, "height_m": 56, "width_px": 1024, "height_px": 1024}
    one = Site.model_validate({**site.model_dump(by_alias=True), "cameras": [above]})
    with World(one, seed=seed) as world:
        frame = _frames(world, 1.0)
    pipeline = Pipeline(one, model, Tracker(site.vision.loose))
    words = Wishes(one).vocabulary(0.0)
    begin = time.perf_counter()
    pipeline.look(frame, (), words)
    # from the second look on, unchanged, things are believed and become messages
    for _ in range(CONFIRM_LOOKS - 1):
        pipeline.look(frame, (), words)
    messages = [message(track) for track in pipeline.tracker.named]
    spent = time.perf_counter() - begin
    if len(messages) < len(site.things):
        raise RuntimeError(f"only {len(messages)} of {len(site.things)} things were found")
    return spent


def _accuracy(site: Site, model: ClipModel) -> tuple[list[float], int, int]:
    """Return the position errors of what was found under its right name, how many that were, and of how many."""
    errors: list[float] = []
    for seed in SEEDS:
        pipeline = Pipeline(site, model, Tracker(site.vision.loose))
        with World(site, seed=seed) as world:
            stands = tuple(Stand(m.x, m.y, m.yaw, m.kind) for m in world.machines.values())
            for number in range(CONFIRM_LOOKS):
                pipeline.look(_frames(world, float(number)), stands, Wishes(site).vocabulary(0.0))
        where = {t.name: t.position for t in pipeline.tracker.named}
        errors += [math.dist(where[t.name], (t.position.x, t.position.y)) for t in site.things if t.name in where]
    return errors, sum(e < 1.0 for e in errors), len(SEEDS) * len(site.things)


def _frames(world: World, at: float) -> dict[str, Frame]:
    return {c.id: Frame(pinhole(c).frame(c.id, 0, at), jpeg(world.render(c))) for c in world.site.cameras}
