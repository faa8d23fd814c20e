"""Site time keeps to the wall clock, comes back gently after a delay, and tells how fast it goes."""

import pytest
from muster_sim.pace import DEBT_S, Pace

STEP_S = 1 / 60
BITE_S = 0.01


def drive(pace: Pace, begin_s: float, seconds: float, *, slow_s: float = 0.0) -> int:
    """Look at the clock every BITE_S (plus `slow_s`) and return the steps done."""
    steps, now = 0, begin_s
    while now < begin_s + seconds - 1e-9:
        now += BITE_S + slow_s
        steps += pace.due(now, BITE_S)
    return steps


@pytest.mark.parametrize("factor", [0.5, 1.0, 10.0])
def test_site_time_passes_as_asked(factor: float) -> None:
    """In ten seconds, ten times the factor."""
    pace = Pace(factor, STEP_S, now_s=100.0)
    assert drive(pace, 100.0, 10.0) * STEP_S == pytest.approx(10 * factor, abs=2 * STEP_S)
    assert pace.achieved_factor == pytest.approx(factor, rel=0.05)


def test_a_short_delay_is_made_up_for_in_small_bites() -> None:
    """No look at the clock gives more than twice the normal number of steps."""
    pace = Pace(10.0, STEP_S, now_s=0.0)
    assert pace.due(0.3, BITE_S) <= 2 * BITE_S * 10 / STEP_S + 1
    assert (drive(pace, 0.3, 2.0) + 12) * STEP_S == pytest.approx(23, abs=0.2)


def test_a_long_pause_is_not_made_up_for() -> None:
    """After an hour's sleep only half a second comes back."""
    pace = Pace(1.0, STEP_S, now_s=0.0)
    pace.due(3600.0, BITE_S)
    assert drive(pace, 3600.0, 5.0) * STEP_S == pytest.approx(5 + DEBT_S, abs=0.1)


def test_a_machine_that_is_too_slow_says_so() -> None:
    """The achieved factor is what was reached, not what was asked for."""
    pace = Pace(100.0, STEP_S, now_s=0.0)
    drive(pace, 0.0, 5.0, slow_s=0.09)
    assert 0 < pace.achieved_factor < 30
