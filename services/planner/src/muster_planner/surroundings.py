"""What a plan may name: the robots that are there, the objects on the map, the site's skills."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from muster_schemas.mission import Reason
from muster_schemas.robot import RobotCard
from muster_schemas.site import Site
from muster_schemas.skills import Catalogue

from .llm import Feedback, PlanRequest
from .mentions import corrects_itself, kinds_of, numbers_of

_MAX_LOOKED_FOR = 16


@dataclass(frozen=True)
class Surroundings:
    """The site at one moment."""

    roster: tuple[RobotCard, ...]
    objects: tuple[str, ...]
    catalogue: Catalogue
    letters: Mapping[str, str]
    """Robot type -> its letter in the site's file."""
    classes: tuple[str, ...] = ()
    """What the cameras can look for."""

    @classmethod
    def of_file(cls, site: Site) -> "Surroundings":
        """Return the site as its file describes it: every robot there, every thing seen."""
        return cls(
            roster=tuple(site.card(r.id, boot_id="offline") for r in site.robots),
            objects=tuple(sorted(t.name for t in site.things)),
            catalogue=site.catalogue,
            letters=letters_of(site),
            classes=object_classes(site),
        )

    def request(
        self,
        text: str,
        feedback: Feedback | None,
        *,
        timeout_s: float,
        max_tokens: int,
        background: str | None = None,
    ) -> PlanRequest:
        """Return the request to a model for an instruction here."""
        return PlanRequest(
            text=text,
            background=background,
            roster=self.roster,
            objects=self.objects,
            catalogue=self.catalogue,
            letters=self.letters,
            feedback=feedback,
            timeout_s=timeout_s,
            max_tokens=max_tokens,
        )

    def to_look_for(self, text: str) -> list[str]:
        """Return names of objects that the text mentions by class (and number) and the map lacks.

        A model is told only what the map holds, so what it lacks must be looked for before the model is asked.
        """
        named = numbers_of(text, self.classes, robots=False)
        first = ((kind, 1) for kind in kinds_of(text, self.classes))
        wanted = dict.fromkeys(f"{kind}{number}" for kind, number in (*named, *first))
        return [name for name in wanted if name not in self.objects][:_MAX_LOOKED_FOR]

    def absent(self, text: str) -> list[Reason]:
        """Return a reason for each robot and object that the text names by number and that is not there.

        A text that takes something back is left to the model, since it may be the number that it takes back.
        """
        if corrects_itself(text):
            return []
        seen, there = ", ".join(self.objects) or "none", ", ".join(c.robot_id for c in self.roster) or "none"
        reasons = [
            Reason(code="unknown_object", message=f"There is no {kind} {n} on the site. Objects seen: {seen}."[:1000])
            for kind, n in dict.fromkeys(numbers_of(text, self.classes, robots=False))
            if f"{kind}{n}" not in self.objects
        ]
        types = sorted({c.type for c in self.roster} | set(self.letters))
        numbers = {(c.type, int(_final_number(c.robot_id))) for c in self.roster}
        reasons += [
            Reason(
                code="unknown_robot",
                message=f"There is no {kind.replace('_', ' ')} {n} on the site now. Robots there: {there}."[:1000],
            )
            for kind, n in dict.fromkeys(numbers_of(text, types, robots=True))
            if (kind, n) not in numbers
        ]
        return reasons


def _final_number(robot_id: str) -> str:
    digits = re.search(r"\d{1,9}$", robot_id)
    return digits[0] if digits else "0"


def letters_of(site: Site) -> dict[str, str]:
    """Return robot type -> letter, for the types whose letter the site's file gives."""
    return {name: kind.letter for name, kind in site.robot_types.items() if kind.letter}


def object_classes(site: Site) -> tuple[str, ...]:
    """Return the classes of objects that are not robots."""
    return tuple(c for c in site.vision.classes if c not in site.robot_types)
