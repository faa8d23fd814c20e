"""The channel table: keys and ids are inverse, and no key belongs to two channels."""

from itertools import combinations, product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_schemas.channels import CHANNELS, ROBOT_STATE, Channel, Kind, all_of, find
from muster_schemas.examples import EXAMPLES
from muster_schemas.ids import ID_PATTERN, InvalidIdError

IDS = st.from_regex(ID_PATTERN, fullmatch=True)


def intersect(a: str, b: str) -> bool:
    """Return whether some key matches both expressions, in which `*` stands for one part."""
    parts = list(zip(a.split("/"), b.split("/"), strict=False))
    return len(a.split("/")) == len(b.split("/")) and all(x == y or "*" in (x, y) for x, y in parts)


def named(channel: Channel[Any]) -> str:
    """Name a test after its channel."""
    return channel.name


def test_no_two_channels_share_a_key() -> None:
    """A key belongs to one channel, so one model says what stands on it."""
    shared = [(a.name, b.name) for a, b in combinations(CHANNELS, 2) if intersect(a.key(), b.key())]
    assert shared == []


def test_names_are_unique_and_each_is_in_the_table() -> None:
    """A channel's name, under which messages are counted, names one channel."""
    assert len({c.name for c in CHANNELS}) == len(CHANNELS)


@pytest.mark.parametrize("channel", CHANNELS, ids=named)
@given(data=st.data())
def test_the_ids_of_a_key_are_those_it_was_made_of(channel: Channel[Any], data: st.DataObject) -> None:
    """`ids` undoes `key` for all valid ids, and `find` finds the channel."""
    ids = {field: data.draw(IDS, field) for field in channel.fields}
    key = channel.key(**ids)
    assert channel.ids(key) == ids
    assert find(key) == (channel, ids)


@pytest.mark.parametrize("channel", [c for c in CHANNELS if len(c.fields) > 1], ids=named)
def test_ids_that_are_left_out_are_wildcards(channel: Channel[Any]) -> None:
    """A key without ids is an expression for all of them, and no key itself."""
    assert channel.key(site="yard").count("*") == len(channel.fields) - 1
    assert channel.ids(channel.key(site="yard")) is None


@pytest.mark.parametrize(
    "bad", ["", "*", "**", "$*", "a/b", "A", "é", "a b", "a\n", "a" * 65, "a?", "#", "../x", "a.b"]
)
def test_a_bad_id_gets_into_no_key(bad: str) -> None:
    """Nothing that means something to Zenoh, a path or a URL gets through, in either direction."""
    with pytest.raises(InvalidIdError, match="robot_id"):
        ROBOT_STATE.key(site="yard", robot_id=bad)
    assert ROBOT_STATE.ids(f"muster/yard/robots/{bad}/state") is None


def test_an_id_that_the_channel_lacks_is_a_mistake() -> None:
    """A misspelt id is not taken for a wildcard."""
    with pytest.raises(TypeError, match="robot_state has no robot"):
        ROBOT_STATE.key(robot="a")


@pytest.mark.parametrize(
    "key", ["", "muster", "muster/yard/robots/a/nothing", "other/yard/robots/a/state", "muster//areas"]
)
def test_a_foreign_key_is_nobodys(key: str) -> None:
    """`find` says so instead of guessing."""
    assert find(key) is None


@pytest.mark.parametrize(("a", "b"), list(product(["yard"], ["robots/x/state", "areas"])))
def test_everything_of_a_site_lies_below_one_expression(a: str, b: str) -> None:
    """Monitors subscribe to one expression."""
    assert all_of(a) == "muster/yard/**"
    assert f"muster/{a}/{b}".startswith(all_of(a).removesuffix("**"))


@pytest.mark.parametrize("channel", CHANNELS, ids=named)
def test_each_row_is_complete(channel: Channel[Any]) -> None:
    """Queries have a reply, streams a rate, everything an owner and a meaning, and an example unless it is a token."""
    assert (channel.reply is not None) == (channel.kind is Kind.QUERY)
    assert channel.kind is not Kind.STREAM or channel.rate_hz
    assert channel.owner
    assert channel.what
    assert (channel.name in EXAMPLES) == (channel.kind is not Kind.LIVELINESS)
