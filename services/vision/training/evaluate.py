"""How good the model and the detector are on layouts that training never saw: `python -m training.evaluate`.

Prints precision and recall of the classifier on held-out crops, then of the whole detector on held-out scenes, with
the error of the positions that it gives.
"""

import argparse
import math
import tempfile
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from muster_vision.clip_model import ClipModel
from muster_vision.detector import SMALLEST_LOOSE_M2, THRESHOLD, Detector
from muster_vision.robots import shadows
from muster_vision.tracker import Sighting
from muster_vision.vocabulary import Vocabulary

from .render_crops import LABELS, Crops
from .scenes import CLASSES, Scene, Truth, scenes
from .train import FIRST_HELD_OUT, crops_of
from .words import CORE, WORDS

MATCH_M = 1.0
NOT_IN_MAP = ("excavator", "dump_truck", "carrier")


def classifier(model: ClipModel, crops: Crops) -> dict[str, tuple[float, float]]:
    """Return (precision, recall) of each of the default site's classes on crops."""
    words = Vocabulary({c: WORDS[c][0] for c in CLASSES[:CORE]}, frozenset())
    scores = model.scores(list(crops.pictures), words.prompts)[:, :CORE]
    said = np.where(scores.max(axis=1) >= THRESHOLD, scores.argmax(axis=1), -1)
    result: dict[str, tuple[float, float]] = {}
    for number, name in enumerate(words.names):
        right = int(((said == number) & (crops.labels == LABELS.index(name))).sum())
        result[name] = (
            right / max(1, int((said == number).sum())),
            right / max(1, int((crops.labels == LABELS.index(name)).sum())),
        )
    return result


def look(model: ClipModel, scene: Scene) -> list[Sighting]:
    """Return what the detector sees in a scene, asked for the classes that it shows."""
    detector = Detector(model, flat=("puddle", "mat"), loose=("soil",))
    words = Vocabulary({c: WORDS[c][0] for c in CLASSES}, frozenset(NOT_IN_MAP))
    return detector.look(scene.view, words, shadows(scene.view, ()))


def free(truth: Truth, scene: Scene) -> bool:
    """Whether a thing can be asked for: large enough, wholly in view, and no machine near it."""
    grid = scene.view.grid
    if truth.machine or (truth.label == "soil" and truth.area_m2 < 1.3 * SMALLEST_LOOSE_M2):
        return False
    west, south, east, north = truth.box
    inside = (
        grid.min_x < west
        and east < grid.min_x + grid.columns * grid.cell_m
        and grid.max_y - grid.rows * grid.cell_m < south
        and north < grid.max_y
    )
    return inside and not any(
        west < t.box[2] + 0.5 and t.box[0] < east + 0.5 and south < t.box[3] + 0.5 and t.box[1] < north + 0.5
        for t in scene.truths
        if t is not truth and (t.machine or t.label != truth.label)
    )


def main() -> None:
    """Print both evaluations."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=25)
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "muster-vision-training")
    parser.add_argument("--model", default="", help="local-dir:FOLDER; the shipped one if left out")
    options, _ = parser.parse_known_args()
    options.work.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    model = ClipModel(options.model)
    crops = crops_of(FIRST_HELD_OUT, options.scenes, options.work)
    print(f"{len(crops.labels)} held-out crops")
    for name, (precision, recall) in classifier(model, crops).items():
        print(f"  {name:12} precision {precision:.3f}  recall {recall:.3f}")
    found: Counter[str] = Counter()
    asked: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    errors: list[float] = []
    for scene in scenes(FIRST_HELD_OUT, options.scenes):
        sightings = look(model, scene)
        for truth in scene.truths:
            if not free(truth, scene):
                continue
            asked[truth.label] += 1
            gaps = [math.dist(s.position, (truth.x, truth.y)) for s in sightings if s.object_class == truth.label]
            if gaps and min(gaps) < MATCH_M:
                found[truth.label] += 1
                errors.append(min(gaps))
        for sighting in sightings:
            near = (math.dist(sighting.position, (t.x, t.y)) < max(MATCH_M, math.sqrt(t.area_m2 / math.pi))
                    for t in scene.truths if t.label == sighting.object_class)  # fmt: skip
            wrong[sighting.object_class] += not any(near)
    print(f"{options.scenes} held-out scenes")
    for name in sorted(asked):
        print(f"  {name:12} found {found[name]} of {asked[name]}, wrongly {wrong[name]}")
    print(f"  position error: median {np.median(errors):.3f} m, 95 % {np.percentile(errors, 95):.3f} m")


if __name__ == "__main__":
    main()
