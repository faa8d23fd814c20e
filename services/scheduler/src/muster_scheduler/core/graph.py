"""A mission's graph of tasks; the one place that touches networkx, which comes without types."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import networkx


class TaskGraph:
    """Task ids with an edge from each task to those that wait for it. Acyclic: the gate has seen to it."""

    def __init__(self, after: Mapping[str, Sequence[str]]) -> None:
        """`after` gives each task's dependencies.

        Raises:
            ValueError: the tasks wait for each other.

        """
        graph: Any = cast("Any", networkx).DiGraph()
        graph.add_nodes_from(after)
        graph.add_edges_from((before, task) for task, dependencies in after.items() for before in dependencies)
        nx = cast("Any", networkx)
        if not nx.is_directed_acyclic_graph(graph):
            raise ValueError("the tasks wait for each other")
        self._graph = graph

    def successors(self, task_id: str) -> Iterable[str]:
        """Return the tasks that wait directly for this one."""
        return cast("Iterable[str]", self._graph.successors(task_id))

    def predecessors(self, task_id: str) -> Iterable[str]:
        """Return the tasks that this one waits for directly."""
        return cast("Iterable[str]", self._graph.predecessors(task_id))

    def steps_to(self, task_id: str) -> dict[str, int]:
        """Return every later task with its distance in steps, nearest first."""
        return self._steps(self._graph, task_id)

    def steps_from(self, task_id: str) -> dict[str, int]:
        """Return every earlier task with its distance in steps, nearest first."""
        return self._steps(self._graph.reverse(copy=False), task_id)

    @staticmethod
    def _steps(graph: Any, task_id: str) -> dict[str, int]:
        nx = cast("Any", networkx)
        steps = cast("dict[str, int]", dict(nx.single_source_shortest_path_length(graph, task_id)))
        del steps[task_id]
        return steps
