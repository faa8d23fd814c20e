"""Tasks that wait for one robot or one type of robot, first come by priority."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import BeforeValidator, Field

Order = tuple[float, int, int]
"""(urgency of the mission, most urgent lowest; mission by age; task in plan order): one order over all tasks.

It never changes while a task waits: see `Mission.urgency`.
"""


def _from_json_key(key: object) -> object:
    return tuple(key.split(",")) if isinstance(key, str) else key


TaskKey = Annotated[tuple[str, str], BeforeValidator(_from_json_key)]
"""(mission id, task id). As a key in a snapshot's JSON it stands as "mission,task": ids have no commas."""


@dataclass(slots=True)
class WaitQueue:
    """A heap with late removal, so that joining, leaving and looking at the front cost O(log n)."""

    heap: Annotated[list[tuple[Order, TaskKey]], Field(exclude=True)] = field(
        default_factory=list[tuple[Order, TaskKey]], compare=False
    )
    waiting: dict[TaskKey, Order] = field(default_factory=dict[TaskKey, Order])

    def __post_init__(self) -> None:
        if len(self.heap) < len(self.waiting):  # fresh from a snapshot
            self.heap = [(order, key) for key, order in self.waiting.items()]
            heapq.heapify(self.heap)

    def add(self, order: Order, key: TaskKey) -> None:
        """Join; joining twice is joining once."""
        if self.waiting.get(key) != order:
            self.waiting[key] = order
            heapq.heappush(self.heap, (order, key))

    def remove(self, key: TaskKey) -> None:
        """Leave; the heap's entry goes when it comes to the front."""
        self.waiting.pop(key, None)
        if not self.waiting:
            self.heap.clear()

    def first(self, count: int) -> list[TaskKey]:
        """Return the first `count` that wait."""
        found: list[tuple[Order, TaskKey]] = []
        for entry in self._drain():
            if entry not in found:
                found.append(entry)
            if len(found) == count:
                break
        for entry in found:
            heapq.heappush(self.heap, entry)
        return [key for _, key in found]

    def _drain(self) -> Iterator[tuple[Order, TaskKey]]:
        while self.heap:
            order, key = heapq.heappop(self.heap)
            if self.waiting.get(key) == order:
                yield order, key
