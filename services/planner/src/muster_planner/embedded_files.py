"""Where the embedded model's files are: beside this module, made by `training/`."""

from pathlib import Path

from .errors import ModelMissingError

FOLDER = Path(__file__).parent / "models" / "planner"
FILES = ("reader.onnx", "writer.onnx", "tokenizer.json")


def model_folder() -> Path:
    """Return the folder with the model's files.

    Raises:
        ModelMissingError: one of them is not there.

    """
    for name in FILES:
        if not (FOLDER / name).is_file():
            raise ModelMissingError(f"The embedded model's file {name} is missing. Install the planner again.")
    return FOLDER
