"""Messages to bytes and back: what may stand on a key, how large it may be, and what is turned away.

Nothing that comes from the wire raises anything but `MalformedError` here, whatever it holds.
"""

from typing import Any, Final, TypeVar

import zenoh
from muster_schemas.channels import Channel, Kind
from pydantic import BaseModel, ValidationError

from .errors import TooBigError, WrongMessageError

M = TypeVar("M", bound=BaseModel)

JSON: Final = zenoh.Encoding.APPLICATION_JSON
JPEG: Final = zenoh.Encoding.IMAGE_JPEG
MAX_MESSAGE_BYTES: Final = 16 * 2**20
"""Largest message that a session takes at all."""
MAX_ATTACHMENT_BYTES: Final = 64 * 2**10

_LIMITS: Final = {
    Kind.EVENT: 64 * 2**10,
    Kind.COMMAND: 64 * 2**10,
    Kind.STATE: 2**20,
    Kind.STREAM: 4 * 2**20,
    Kind.QUERY: 8 * 2**20,
    Kind.LIVELINESS: 0,
}
_NAMED_OTHERWISE: Final = {"object_name": "name"}
"""Ids whose field in the model has another name than in the key."""


class MalformedError(Exception):
    """Something on the wire that no message of its channel can be; the text says why."""


def size_limit(channel: Channel[Any]) -> int:
    """Return the most bytes that a payload of this channel may have."""
    return 8 * 2**20 if channel.binary else _LIMITS[channel.kind]


def concrete_key(channel: Channel[Any], site: str, ids: dict[str, str]) -> str:
    """Return the key that exactly these ids name.

    Raises:
        TypeError: an id is missing or unknown.
        InvalidIdError: an id has characters that a key may not have.

    """
    missing = [f for f in channel.fields if f != "site" and f not in ids]
    if missing:
        raise TypeError(f"channel {channel.name} needs {', '.join(sorted(missing))}")
    return channel.key(site=site, **ids)


def encode(channel: Channel[M], message: M, ids: dict[str, str]) -> bytes:
    """Return the JSON of a message that is about to go out.

    Raises:
        WrongMessageError: it is not of the channel's model, or says other ids than its key.
        TooBigError: it is larger than the channel allows.

    """
    if not isinstance(message, channel.model):
        raise WrongMessageError(f"channel {channel.name} takes {channel.model.__name__}, not {type(message).__name__}")
    other = _other_ids(message, ids)
    if other:
        raise WrongMessageError(f"channel {channel.name}: {other}")
    return checked_size(channel, message.model_dump_json(by_alias=True).encode())


def checked_size(channel: Channel[Any], payload: bytes) -> bytes:
    """Return the payload unchanged.

    Raises:
        TooBigError: it is larger than the channel allows.

    """
    if len(payload) > size_limit(channel):
        raise TooBigError(f"channel {channel.name} takes {size_limit(channel)} bytes at most, not {len(payload)}")
    return payload


def decode_sample(channel: Channel[M], ids: dict[str, str], sample: zenoh.Sample) -> tuple[M, bytes]:
    """Return the message of a put and, on a binary channel, its bytes.

    Raises:
        MalformedError: too big, wrong encoding, not the model's JSON, or its ids differ from the key's.

    """
    limit = size_limit(channel)
    if len(sample.payload) > limit:
        raise MalformedError(f"has {len(sample.payload)} bytes, more than {limit}")
    wanted = JPEG if channel.binary else JSON
    if sample.encoding != wanted:
        raise MalformedError(f"has the encoding {str(sample.encoding)[:60]!r}, not {wanted}")
    payload = sample.payload.to_bytes()
    if not channel.binary:
        return _checked_ids(parse(channel.model, payload), ids), b""
    attachment = sample.attachment
    if attachment is None or len(attachment) > MAX_ATTACHMENT_BYTES:
        raise MalformedError(f"needs an attachment of at most {MAX_ATTACHMENT_BYTES} bytes")
    return _checked_ids(parse(channel.model, attachment.to_bytes()), ids), payload


def parse(model: type[M], payload: bytes) -> M:
    """Return the message that this JSON holds.

    Raises:
        MalformedError: it is no JSON (bad UTF-8, too deep, ...) or breaks a rule of the model.

    """
    try:
        return model.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])[:80]
        raise MalformedError(f"{where or model.__name__}: {first['msg'][:200]}") from error


def _checked_ids(message: M, ids: dict[str, str]) -> M:
    other = _other_ids(message, ids)
    if other:
        raise MalformedError(other)
    return message


def _other_ids(message: BaseModel, ids: dict[str, str]) -> str | None:
    """Return how the ids in the message differ from those of its key, or None."""
    for field, value in ids.items():
        said = getattr(message, _NAMED_OTHERWISE.get(field, field), value)
        if said != value:
            return f"its {field} is {str(said)[:80]!r}, its key says {value!r}"
    return None
