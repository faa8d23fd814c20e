"""The shipped model, and others in its place."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from muster_vision.camera import Picture
from muster_vision.clip_model import SHIPPED, ClipModel, ModelError
from muster_vision.settings import VisionSettings
from pydantic import ValidationError


def test_probabilities_of_all_meanings_add_up_to_one(model: ClipModel) -> None:
    """For crops of any size."""
    crops = [np.full((side, side, 3), 90, np.uint8) for side in (7, 64, 150)]
    scores = model.scores(crops, [("a rock", "a stone"), ("bare ground",)])
    assert scores.shape == (3, 2)
    assert scores.sum(axis=1) == pytest.approx(1.0, abs=1e-5)


def test_no_crops_have_no_scores(model: ClipModel) -> None:
    """Nothing is asked of the model."""
    assert model.scores([], [("a rock",), ("bare ground",)]).shape == (0, 2)


def test_the_shipped_weights_are_small() -> None:
    """They travel with the source."""
    assert sum(f.stat().st_size for f in SHIPPED.iterdir()) < 20e6


def test_a_word_that_nobody_knows_fits_nothing(model: ClipModel, one_rock: Picture) -> None:
    """A keyword outside the model's world finds no rock."""
    words = [("a zygomorphic quaternion",), ("a grey rock",), ("bare ground",), ("some other thing",)]
    scores = model.scores([one_rock], words)[0]
    assert scores[1] > 0.9
    assert scores[0] < 0.05


def test_any_other_model_of_open_clip_takes_its_place(tmp_path: Path, one_rock: Picture) -> None:
    """By name and a file of weights (here: as they are before training)."""
    open_clip: Any = importlib.import_module("open_clip")
    torch: Any = importlib.import_module("torch")
    path = tmp_path / "weights.pt"
    torch.save(open_clip.create_model("RN50", precision="fp32").state_dict(), path)
    other = ClipModel("RN50", str(path))
    assert other.scores([one_rock], [("a rock",), ("a puddle",)]).sum() == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "weights"), [("NoSuchModel", "x"), ("ViT-B-32", "no_such_tag"), ("local-dir:/no", "")]
)
def test_a_model_that_does_not_exist_is_refused_with_the_settings_to_change(name: str, weights: str) -> None:
    """Without asking anyone on the network."""
    with pytest.raises(ModelError, match="MUSTER_VISION_MODEL"):
        ClipModel(name, weights)


@pytest.mark.parametrize(("name", "weights"), [("ViT-B-32", ""), ("ViT-B-32", "/no/such/file.pt")])
def test_settings_that_cannot_be_right_are_refused_at_once(name: str, weights: str) -> None:
    """Before anything heavy is loaded."""
    with pytest.raises(ValidationError, match=r"weights|no file"):
        VisionSettings(vision_model=name, vision_pretrained=weights)


@pytest.fixture
def one_rock(film: Callable[..., Any], yard: Any) -> Picture:
    """Provide a crop of the default site's rock."""
    world_class = importlib.import_module("muster_sim.world").World
    with world_class(yard) as world:
        view = film(world)
    window = view.grid.around(np.array([[7.0, -2.0]]), 1.2)
    return view.picture[window.cells]
