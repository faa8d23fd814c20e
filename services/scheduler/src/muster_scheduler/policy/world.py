"""What is seen of the site now. Not journaled: what was decided from it is."""

from dataclasses import dataclass, field

from muster_schemas.base import Pose
from muster_schemas.robot import RobotCard
from muster_schemas.site import Bounds
from muster_schemas.world import MapObject


@dataclass(slots=True)
class World:
    """Where robots and objects are, as last told."""

    bounds: Bounds
    poses: dict[str, Pose] = field(default_factory=dict[str, Pose])
    objects: dict[str, MapObject] = field(default_factory=dict[str, MapObject])

    def pose(self, card: RobotCard) -> Pose:
        """Return where a robot is; one that has not said so yet is taken to be at home."""
        return self.poses.get(card.robot_id, card.home)
