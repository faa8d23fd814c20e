"""Tasks that wait for one robot or one type of robot, first come by priority."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, field

Order = tuple[float, int, int]
"""(urgency of the mission, most urgent lowest; mission by age; task in plan order): one order over all tasks.

It never changes while a task waits: see `Mission.urgency`.
"""

TaskKey = tuple[str, str]
"""(mission id, task id)."""


@dataclass(slots=True)
class WaitQueue:
    """A heap with late removal, so that joining, leaving and looking at the front cost O(log n)."""

    heap: list[tuple[Order, TaskKey]] = field(default_factory=list[tuple[Order, TaskKey]], compare=False)
    waiting: dict[TaskKey, Order] = field(default_factory=dict[TaskKey, Order])

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
