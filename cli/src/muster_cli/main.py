"""The `muster` command: start a site, give it instructions, and see what becomes of them."""

import asyncio
import logging
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Annotated, Any

import structlog
import typer
from muster_bus import Bus
from muster_schemas.mission import MAX_TEXT, MissionStatus
from rich.console import Console

from . import demo as demo_run
from . import evaluation, plans, site
from .editing import edit_from_file, edit_in_editor
from .errors import CliError
from .follow import follow
from .ids import checked_mission_id, checked_robot_id, checked_task_id
from .monitor import print_lines, show_table
from .processes import Driver
from .record import DataDirectory
from .rest import OperatorApi
from .settings import read_settings
from .views import mission_table, missions_table

app = typer.Typer(
    help="Muster: one sentence in, a crew of robots at work.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
_out = Console()

SiteFile = Annotated[Path | None, typer.Option("--site", help="The site's file; left out: MUSTER_SITE_FILE.")]
MissionId = Annotated[str, typer.Argument(metavar="ID", help="The mission, as `muster missions` shows it.")]
PLANNERS = "embedded, ollama:MODEL, openai:MODEL or anthropic:MODEL."
TaskId = Annotated[str, typer.Argument(metavar="TASK", help="The task, as `muster missions ID` shows it: t2.")]
RobotId = Annotated[str | None, typer.Argument(metavar="[ROBOT]", help="The robot's id; left out: all.")]
Planner = Annotated[str, typer.Option(help=PLANNERS, envvar="MUSTER_PLANNER")]
Speed = Annotated[float, typer.Option(min=0.1, max=100, help="Simulated seconds in each second.")]


@app.command()
def up(
    site_file: SiteFile = None,
    speed: Speed = 1.0,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of the operator's interface.")] = 8000,
    bus_port: Annotated[int, typer.Option(min=1, max=65535, help="Of the router.")] = 7447,
    driver: Annotated[Driver, typer.Option(help="What moves the robots.")] = "sim",
    planner: Planner = "embedded",
) -> None:
    """Start the whole site on this machine and leave it running."""
    settings = read_settings()
    options = site.options(
        settings, site_file, speed=speed, port=port, bus_port=bus_port, driver=driver, planner=planner
    )
    site.up(options, _out)


@app.command()
def down() -> None:
    """Stop the site that `muster up` started."""
    site.down(read_settings().data_dir, _out)


@app.command()
def status() -> None:
    """Show the processes of the site on this machine."""
    if not site.show(DataDirectory(read_settings().data_dir), _out):
        raise CliError("No site is up on this machine. `muster up` starts one.")


@app.command()
def run(
    text: Annotated[str, typer.Argument(help="What is to be done, in your own words.")],
    priority: Annotated[int, typer.Option(min=0, max=9, help="A higher one gets robots first.")] = 5,
    approval: Annotated[bool, typer.Option("--approval", help="Show the plan and ask before anything moves.")] = False,
) -> None:
    """Give the site an instruction and follow it to its end. Ctrl-C stops following, not the mission."""
    _check_text(text)
    with _api() as api:
        mission_id = api.submit(text, priority, "ask" if approval else "auto")
        _follow(api, mission_id)


@app.command()
def missions(mission_id: Annotated[str | None, typer.Argument(metavar="[ID]")] = None) -> None:
    """List the missions, or show one with its tasks and what they wait for."""
    with _api() as api:
        if mission_id is None:
            _out.print(missions_table(api.missions()))
        else:
            _out.print(mission_table(api.mission(checked_mission_id(mission_id))))


@app.command("follow")
def follow_one(mission_id: MissionId) -> None:
    """Follow a mission to its end."""
    with _api() as api:
        _follow(api, checked_mission_id(mission_id))


def _action(name: str, what: str) -> None:
    def act(mission_id: MissionId) -> None:
        with _api() as api:
            reply = api.act(checked_mission_id(mission_id), name)
        _out.print(f"{mission_id}: {reply.state.value.replace('_', ' ')}", highlight=False)
        for robot_id, known in reply.robots.items():
            _out.print(f"  {robot_id}: {known}", markup=False, highlight=False)

    app.command(name, help=what)(act)


_action("cancel", "End a mission; its robots stop.")
_action("pause", "Halt a mission's robots until `muster resume`.")
_action("resume", "Let a paused mission go on.")
_action("approve", "Let a plan that awaits approval run.")
_action("reject", "Turn a plan down that awaits approval.")


def _decision(name: str, what: str) -> None:
    def decide(mission_id: MissionId, task_id: TaskId) -> None:
        with _api() as api:
            reply = api.decide(checked_mission_id(mission_id), checked_task_id(task_id), name)
        _out.print(f"{mission_id}: {reply.state.value.replace('_', ' ')}", highlight=False)

    app.command(name, help=what)(decide)


_decision("retry", "Try a task again that failed and waits for a decision.")
_decision("skip", "Go on without a task that failed and waits for a decision.")
_decision("replan", "Have such a task, and what comes after it, planned anew.")


@app.command()
def edit(
    mission_id: MissionId,
    file: Annotated[Path | None, typer.Option(help="A plan as JSON; left out: the editor opens.")] = None,
) -> None:
    """Edit a plan that awaits approval. A plan that cannot run is refused and changes nothing."""
    with _api() as api:
        if file is not None:
            edit_from_file(api, checked_mission_id(mission_id), file, _out)
        else:
            edit_in_editor(api, checked_mission_id(mission_id), _out)


def _stopping(name: str, what: str, *, stop: bool) -> None:
    def act(robot_id: RobotId = None) -> None:
        checked = None if robot_id is None else checked_robot_id(robot_id)
        with _api() as api:
            reply = api.stop(checked, stop=stop)
        if reply.site_stopped:
            _out.print("the site is stopped; `muster release` lets it go on", highlight=False)
        for robot, known in reply.robots.items():
            _out.print(f"  {robot}: {known}", markup=False, highlight=False)

    app.command(name, help=what)(act)


_stopping("stop", "Have a robot, or everything, stand still until `muster release`.", stop=True)
_stopping("release", "Let a stopped robot, or everything, go on.", stop=False)


@app.command()
def plan(
    text: Annotated[str | None, typer.Argument(help="What is to be done, in your own words.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the plan in its published form.")] = False,
    batch: Annotated[Path | None, typer.Option(help='A file of lines {"id", "text"}.')] = None,
    out: Annotated[Path | None, typer.Option(help="Where the batch's plans go.")] = None,
    site_file: SiteFile = None,
    planner: Planner = "embedded",
) -> None:
    """Show the plan for an instruction, or plan a file of them. Needs no running site; nothing moves."""
    the_site = site.chosen(read_settings(), site_file)
    if batch is not None and out is not None and text is None:
        plans.plan_file(batch, out, the_site, planner)
    elif text is not None and batch is None and out is None:
        _check_text(text)
        plans.plan_text(text, the_site, planner, as_json=as_json, console=_out)
    else:
        raise CliError("Say either one instruction in quotes, or --batch IN.jsonl with --out OUT.jsonl.", 2)


@app.command()
def evaluate(  # noqa: PLR0913, PLR0917 (one for each option)
    dataset: Annotated[Path, typer.Argument(metavar="DATASET.jsonl", help="Instructions with their right plans.")],
    planner: Annotated[str, typer.Option("--planner", "--model", envvar="MUSTER_PLANNER", help=PLANNERS)] = "embedded",
    method: Annotated[evaluation.Method, typer.Option(help="smart-llm: the model writes a program with threads.")] = (
        "dart-llm"
    ),
    no_dependencies: Annotated[
        bool, typer.Option("--no-dependencies", help="Drop the plans' dependencies: the paper's ablation.")
    ] = False,
    repeat: Annotated[int, typer.Option(min=1, max=1000, help="Ask everything so many times.")] = 1,
    limit: Annotated[int | None, typer.Option(min=1, help="Only so many cases, drawn by chance (seeded).")] = None,
    failures: Annotated[bool, typer.Option("--failures", help="List what was wrong, case by case.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="NAME", help="Write NAME.json, NAME.md and NAME.png.")] = None,
    site_file: SiteFile = None,
) -> None:
    """Measure how well a planner plans: SR, IPA, DSR, SGSR, RTR by level. Needs no running site; nothing moves."""
    evaluation.evaluate(
        _out,
        failures=failures,
        out=out,
        dataset=dataset,
        site=site.chosen(read_settings(), site_file),
        planner=planner,
        method=method,
        dependencies=not no_dependencies,
        repeat=repeat,
        limit=limit,
    )


@app.command()
def monitor(
    key: Annotated[str | None, typer.Argument(help="Part of a key, or a pattern with * and **.")] = None,
    plain: Annotated[bool, typer.Option("--plain", help="Lines of JSON instead of a table.")] = False,
) -> None:
    """Show what goes over the bus. Ctrl-C ends."""

    async def watch(bus: Bus) -> None:
        await (print_lines(bus, key) if plain else show_table(bus, key, _out))

    _interruptible(site.on_bus(read_settings(), watch))


@app.command()
def demo(speed: Speed = 4.0) -> None:
    """Start a site of its own, run one real instruction to its end, show what came of it, and stop the site."""
    if not demo_run.demo(read_settings(), speed, _out):
        raise typer.Exit(1)


def _api() -> OperatorApi:
    settings = read_settings()
    token = settings.token.get_secret_value() if settings.token else None
    return OperatorApi(site.url(settings), token)


def _follow(api: OperatorApi, mission_id: str) -> None:
    try:
        view = follow(api, mission_id, _out)
    except KeyboardInterrupt:
        _out.print(
            f"\nThe mission goes on. Look at it with `muster missions {mission_id}`, end it with `muster cancel`."
        )
        raise typer.Exit(130) from None
    if view.mission.state is not MissionStatus.SUCCEEDED:
        raise typer.Exit(1)


def _check_text(text: str) -> None:
    if not text.strip():
        raise CliError("The instruction is empty. Say what is to be done, in quotes.", 2)
    if len(text) > MAX_TEXT:
        raise CliError(f"The instruction has {len(text)} characters; at most {MAX_TEXT} are taken.", 2)


def _interruptible(work: Coroutine[Any, Any, None]) -> None:
    try:
        asyncio.run(work)
    except KeyboardInterrupt:
        raise typer.Exit(0) from None


def _quiet_logs() -> None:
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))


def main(command: Callable[[], None] = app) -> None:
    """Run the command line; what goes wrong is one clear line and an exit code."""
    _quiet_logs()
    try:
        command()
    except CliError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)
