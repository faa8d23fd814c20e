"""`python -m muster_vision`: map the objects of the site of `MUSTER_SITE_FILE` from its cameras."""

import asyncio

import cv2
from muster_bus import Bus
from muster_bus.runtime import run
from muster_bus.settings import read
from muster_schemas.site import load_site

from .clip_model import ClipModel
from .pipeline import Pipeline
from .service import Vision
from .settings import VisionSettings
from .store import MapFile


def main() -> None:
    """Run the service until it is told to stop."""
    settings = read(VisionSettings)
    cv2.setNumThreads(1)

    async def work(bus: Bus, stop: asyncio.Event) -> None:
        site = load_site(settings.site_file)
        file = MapFile(settings.data_dir, site.name)
        tracker = file.load(site.vision.loose)
        # importing the model's libraries takes seconds, in which the bus must be served
        model = await asyncio.to_thread(ClipModel, settings.vision_model, settings.vision_pretrained)
        await Vision(bus, site, Pipeline(site, model, tracker), file).run(stop)

    run("vision", settings, work)


if __name__ == "__main__":
    main()
