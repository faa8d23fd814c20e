"""The site as its file describes it, for planning without services."""

from collections.abc import Collection

from muster_schemas.site import Site

from .surroundings import Surroundings


class FileScene:
    """Every robot of the file is there and every thing seen; there are no cameras to look with."""

    def __init__(self, site: Site) -> None:
        self._surroundings = Surroundings.of_file(site)

    def now(self) -> Surroundings:
        """Return what the file says."""
        return self._surroundings

    async def look_for(self, names: Collection[str]) -> None:
        """Find nothing: what the file lacks is not there."""
