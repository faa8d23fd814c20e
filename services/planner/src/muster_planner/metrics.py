"""What the planner counts, for Prometheus. One registry per process, handed around, so that tests do not share one."""

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from .drafting import Outcome


class Metrics:
    """The planner's own numbers."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._plans = Counter(
            "muster_planner_instructions",
            "Instructions by how planning them ended",
            ["outcome"],
            registry=self.registry,
        )
        self._seconds = Histogram(
            "muster_planner_model_seconds",
            "Model time per instruction, repairs included",
            registry=self.registry,
            buckets=(0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32, 64, 128),
        )
        self._attempts = Counter("muster_planner_attempts", "Model calls", registry=self.registry)
        self._tokens = Counter("muster_planner_tokens", "Tokens, in and out", registry=self.registry)
        self.waiting = Gauge(
            "muster_planner_waiting", "Instructions that wait for their plan or are planned now", registry=self.registry
        )
        self.requests = Counter(
            "muster_planner_http_requests", "HTTP answers", ["method", "route", "status"], registry=self.registry
        )

    def planned(self, outcome: Outcome) -> None:
        """Count one instruction's end."""
        without_plan = "model_failed" if outcome.failure else "refused"
        self._plans.labels("planned" if outcome.plan is not None else without_plan).inc()
        self._seconds.observe(outcome.model_s)
        self._attempts.inc(outcome.attempts)
        self._tokens.inc(outcome.tokens)
