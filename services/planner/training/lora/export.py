# pyright: basic
"""Write the adapter of a run's checkpoint as a llama.cpp LoRA file (GGUF, f16).

python -m training.lora.export --run first --to src/muster_planner/models/planner-lora.gguf
"""

import argparse
from pathlib import Path

import gguf
import numpy as np
import torch

from .train import run_folder


def export(checkpoint: Path, target: Path) -> int:
    """Write `target` and return its size in bytes."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_suffix(".part")
    writer = gguf.GGUFWriter(str(part), "llama")
    writer.add_type("adapter")
    writer.add_string("adapter.type", "lora")
    writer.add_float32("adapter.lora.alpha", float(state["alpha"]))
    writer.add_name("Muster planner")
    writer.add_license("apache-2.0")
    for name, value in state["model"].items():
        # blocks.3.a.attn_q -> blk.3.attn_q.weight.lora_a
        _, block, side, matrix = name.split(".")
        tensor = value.to(torch.float32).numpy().astype(np.float16)
        writer.add_tensor(f"blk.{block}.{matrix}.weight.lora_{side}", np.ascontiguousarray(tensor))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    part.replace(target)
    return target.stat().st_size


def main() -> None:
    """Export from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", default="run")
    parser.add_argument("--to", type=Path, required=True)
    options = parser.parse_args()
    size = export(run_folder(options.run) / "checkpoint.pt", options.to)
    print(f"{options.to}: {size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
