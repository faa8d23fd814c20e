"""The default site as the model reads it."""

from pathlib import Path

from muster_planner.embedded import scene_of
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site

YARD = Surroundings.of_file(load_site(Path(__file__).resolve().parents[4] / "sites" / "yard.yaml"))
NAMES = SiteNames(YARD.roster, YARD.objects, YARD.catalogue, YARD.letters)
SCENE = scene_of(NAMES)
