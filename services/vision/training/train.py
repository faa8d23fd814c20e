"""Train the small open_clip model that ships with Muster: `python -m training.train` from `services/vision`.

Renders crops of random sites (kept in `--work`), trains image and text tower from scratch on one thread, evaluates on
layouts that training never saw, and writes configuration and weights into `src/muster_vision/models/site-clip`.
"""

import argparse
import importlib
import json
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch
from muster_vision.clip_model import SHIPPED

from .render_crops import LABELS, SIDE, Crops, render
from .words import UNKNOWN, asked, nonsense

_torch: Final[Any] = torch  # much of it has no complete types
_open_clip: Final[Any] = importlib.import_module("open_clip")
_safetensors: Final[Any] = importlib.import_module("safetensors.torch")

CONFIG: Final[dict[str, Any]] = {
    "model_cfg": {
        "embed_dim": 128,
        "vision_cfg": {"image_size": SIDE, "layers": [1, 2, 2, 1], "width": 16, "head_width": 64},
        "text_cfg": {"context_length": 24, "vocab_size": 49408, "width": 64, "heads": 2, "layers": 2},
    },
    "preprocess_cfg": {
        "mean": [0.5, 0.5, 0.5],
        "std": [0.25, 0.25, 0.25],
        "interpolation": "bicubic",
        "resize_mode": "squash",
    },
}
FIRST_TRAINED, FIRST_HELD_OUT = 1000, 5000
BATCH: Final = 128
NONSENSE: Final = 6


def train(crops: Crops, epochs: int, seed: int, report_every: int = 20) -> Any:
    """Return a model trained on the crops."""
    _torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "open_clip_config.json").write_text(json.dumps(CONFIG))
        model = _open_clip.create_model(f"local-dir:{folder}")
        tokenizer = _open_clip.get_tokenizer(f"local-dir:{folder}")
    # this layout and half precision make a step twice as fast on a CPU
    model.train().visual.to(memory_format=torch.channels_last)
    optimizer: Any = torch.optim.AdamW(model.parameters(), lr=1e-3, weight_decay=0.05, fused=True)
    steps = epochs * (len(crops.labels) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps, pct_start=0.1)
    began, step = time.monotonic(), 0
    while step < steps:
        order = rng.permutation(len(crops.labels))
        for start in range(0, len(order) - BATCH + 1, BATCH):
            if step >= steps:
                break
            chosen = order[start : start + BATCH]
            prompts = asked(rng)
            names = list(prompts)
            target = torch.tensor([_target(LABELS[i], names) for i in [int(n) for n in crops.labels[chosen]]])
            tokens = torch.cat(
                [
                    tokenizer(list(prompts.values())),
                    nonsense(rng, NONSENSE, tokenizer.context_length, tokenizer.sot_token_id, tokenizer.eot_token_id),
                ]
            )
            pictures = normalized(shaken(_torch.from_numpy(crops.pictures[chosen]).permute(0, 3, 1, 2) / 255, rng))
            with torch.autocast("cpu", torch.bfloat16):
                features = model.encode_image(pictures.contiguous(memory_format=torch.channels_last))
            seen = torch.nn.functional.normalize(features.float(), dim=-1)
            said = model.encode_text(tokens, normalize=True)
            loss: Any = torch.nn.functional.cross_entropy(model.logit_scale.exp() * seen @ said.T, target)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            with torch.no_grad():
                model.logit_scale.clamp_(0, np.log(50))
            step += 1
            if step % report_every == 0:
                spent = time.monotonic() - began
                print(f"step {step} of {steps}, loss {float(loss):.3f}, {spent:.0f} s", flush=True)
    return model.eval()


def shaken(pictures: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """Return pictures (N, 3, 64, 64), 0 to 1, turned, mirrored, zoomed, in other light, and noisy."""
    count = len(pictures)
    pictures = torch.rot90(pictures, int(rng.integers(4)), (2, 3))
    if rng.random() < 0.5:
        pictures = pictures.flip(3)
    theta = torch.zeros(count, 2, 3)
    zoom = _torch.from_numpy(rng.uniform(0.85, 1.1, count)).float()
    theta[:, 0, 0] = theta[:, 1, 1] = zoom
    theta[:, :, 2] = _torch.from_numpy(rng.uniform(-0.06, 0.06, (count, 2))).float()
    grid = torch.nn.functional.affine_grid(theta, list(pictures.shape), align_corners=False)
    pictures = torch.nn.functional.grid_sample(pictures, grid, padding_mode="border", align_corners=False)
    light = _torch.from_numpy(rng.uniform(0.75, 1.25, (count, 1, 1, 1))).float()
    tint = _torch.from_numpy(rng.uniform(0.94, 1.06, (count, 3, 1, 1))).float()
    contrast = _torch.from_numpy(rng.uniform(0.85, 1.15, (count, 1, 1, 1))).float()
    middle = pictures.mean(dim=(2, 3), keepdim=True)
    pictures = ((pictures - middle) * contrast + middle) * light * tint
    noise = _torch.from_numpy(rng.uniform(0, 0.03, (count, 1, 1, 1))).float()
    return (pictures + noise * torch.randn(pictures.shape)).clamp(0, 1)


def normalized(pictures: torch.Tensor) -> torch.Tensor:
    """Return pictures, 0 to 1, as the model takes them."""
    mean = torch.tensor(CONFIG["preprocess_cfg"]["mean"]).view(1, 3, 1, 1)
    return (pictures - mean) / torch.tensor(CONFIG["preprocess_cfg"]["std"]).view(1, 3, 1, 1)


def save(model: Any, folder: Path) -> None:
    """Write the model as open_clip's `local-dir:` takes it, in half precision."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "open_clip_config.json").write_text(json.dumps(CONFIG, indent=1) + "\n")
    weights = {k: v.half() if v.is_floating_point() else v for k, v in model.state_dict().items()}
    _safetensors.save_file({k: v.contiguous() for k, v in weights.items()}, folder / "open_clip_model.safetensors")


def crops_of(first: int, count: int, work: Path) -> Crops:
    """Return the crops of some scenes, from `work` if they were rendered before."""
    path = work / f"crops-{first}-{count}.npz"
    if not path.exists():
        rendered = render(first, count)
        np.savez_compressed(path, pictures=rendered.pictures, labels=rendered.labels)
    with np.load(path) as kept:
        return Crops(kept["pictures"], kept["labels"])


def _target(label: str, names: list[str]) -> int:
    return names.index(label if label in names else UNKNOWN)


def main() -> None:
    """Render, train, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=150)
    parser.add_argument("--epochs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "muster-vision-training")
    parser.add_argument("--out", type=Path, default=SHIPPED)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    crops = crops_of(FIRST_TRAINED, options.scenes, options.work)
    print(f"{len(crops.labels)} crops", flush=True)
    save(train(crops, options.epochs, options.seed), options.out)
    print(f"written to {options.out}", flush=True)


if __name__ == "__main__":
    main()
