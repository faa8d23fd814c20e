"""What a robot can do: each skill is a generator that is stepped by telemetry and ends when it has seen its effect."""
