"""The planner: from an operator's sentence to a plan that passed the gate, behind a REST API."""
