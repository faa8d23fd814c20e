"""Run by `test_journal`: carries out a start and dies by SIGKILL after a number of effects.

Arguments: data folder, history file, number of effects to carry out.
"""

import os
import signal
import sys
from pathlib import Path

from muster_robot_agent.core import Begin, Core, Save
from muster_robot_agent.history import History
from muster_robot_agent.journal import Journal
from muster_robot_agent.testing import request

ROBOT = "robot_excavator_01"
folder, history, effects_left = Path(sys.argv[1]), History(Path(sys.argv[2])), int(sys.argv[3])
start = request(ROBOT, "excavator_digging")
with Journal(folder, ROBOT) as journal:
    core = Core(ROBOT, start.boot_id, [start.skill], attempts=journal.attempts(), epoch=journal.epoch())
    for effect in [*core.recover(1.0), *core.request(start, 1.0)]:
        if effects_left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        effects_left -= 1
        if isinstance(effect, Save):
            journal.save(effect.attempt, effect.epoch)
        elif isinstance(effect, Begin):
            history.write("start", ROBOT, start.ref, start.skill, 0.0)
    os.kill(os.getpid(), signal.SIGKILL)
