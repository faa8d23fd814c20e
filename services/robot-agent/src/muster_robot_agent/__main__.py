"""`python -m muster_robot_agent`: the agent of one robot, or of several kinematic ones."""

from muster_bus.settings import read

from .host import run_agents
from .settings import AgentSettings


def main() -> None:
    """Read the settings and run."""
    settings = read(AgentSettings)
    run_agents(settings, settings.robot_id, settings.driver)


if __name__ == "__main__":
    main()
