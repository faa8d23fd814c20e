"""What the vision service reads from its environment, once."""

import os
from pathlib import Path
from typing import Self

from muster_bus.settings import ServiceSettings
from pydantic import Field, ValidationInfo, field_validator


class VisionSettings(ServiceSettings):
    """MUSTER_VISION_MODEL and MUSTER_VISION_PRETRAINED, beside what every service reads."""

    vision_model: str = Field(default="", max_length=200)
    """An open_clip model (`ViT-B-32`, or `local-dir:FOLDER`); empty: the small one that ships with Muster."""
    vision_pretrained: str = Field(default="", max_length=1000, validate_default=True)
    """Its weights: a path, or a tag of open_clip's."""

    @field_validator("vision_pretrained")
    @classmethod
    def _goes_with_the_model(cls: type[Self], value: str, info: ValidationInfo) -> str:
        model = info.data.get("vision_model", "")
        if model and not model.startswith("local-dir:") and not value:
            raise ValueError(f"the model {model!r} needs weights: the path of a file, or one of open_clip's tags")
        if os.sep in value and not Path(value).is_file():
            raise ValueError(f"there is no file {value!r}")
        return value
