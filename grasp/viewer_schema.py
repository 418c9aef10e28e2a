"""JSON Schema of a message as viewers of MCAP files read it."""

from typing import Any

import msgspec

_Schema = dict[str, Any]


def viewer_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """JSON Schema of a message as MCAP viewers read it: nested objects, no references.

    Viewers refuse a whole channel over a property without a plain ``type``: an optional value is
    described by its type, and what has no plain type at all (a list of lists, a union, a tuple of
    mixed types) is left undescribed, which a schema allows; it is recorded all the same.
    """
    schema = msgspec.json.schema(kind)
    if hasattr(kind, "schema_name"):  # viewers have words of their own for these
        schema = _wordless(schema)
    plain = _plain_schema(schema, schema.get("$defs", {}), ())
    if plain is None or plain["type"] != "object":
        raise TypeError(f"{kind.__name__} is no JSON object")
    return plain


def schema_name(kind: type[msgspec.Struct]) -> str:
    """What viewers know it by: a type of theirs says so itself."""
    return str(getattr(kind, "schema_name", kind.__name__))


def _wordless(schema: Any) -> Any:
    if isinstance(schema, dict):
        return {k: _wordless(v) for k, v in schema.items() if k not in ("title", "description")}
    return [_wordless(each) for each in schema] if isinstance(schema, list) else schema


def _plain_schema(schema: _Schema, defs: _Schema, seen: tuple[str, ...]) -> _Schema | None:
    """The schema without references, or None when a viewer would refuse it."""
    if (reference := schema.get("$ref")) is not None:
        if reference in seen:
            return None
        return _plain_schema(defs[reference.rsplit("/", 1)[-1]], defs, (*seen, reference))
    if "anyOf" in schema:
        options = [option for option in schema["anyOf"] if option.get("type") != "null"]
        return _plain_schema(options[0], defs, seen) if len(options) == 1 else None
    plain = _plain_type(schema, defs, seen)
    notes = {key: schema[key] for key in ("title", "description") if key in schema}
    return None if plain is None else notes | plain


def _plain_type(schema: _Schema, defs: _Schema, seen: tuple[str, ...]) -> _Schema | None:
    match schema.get("type"):
        case "object":
            return _plain_object(schema, defs, seen)
        case "array":
            return _plain_array(schema, defs, seen)
        case "boolean" | "integer" | "number" | "string" as simple:
            encoding = {"contentEncoding": "base64"} if "contentEncoding" in schema else {}
            return {"type": simple, **encoding}
    return _plain_enum(schema.get("enum", []))


def _plain_object(schema: _Schema, defs: _Schema, seen: tuple[str, ...]) -> _Schema:
    plain = {
        name: _plain_schema(value, defs, seen)
        for name, value in schema.get("properties", {}).items()
    }
    described = {name: value for name, value in plain.items() if value is not None}
    return {"type": "object", "properties": described}


def _plain_array(schema: _Schema, defs: _Schema, seen: tuple[str, ...]) -> _Schema | None:
    """An array of one plain type; None for mixed items and for arrays of arrays."""
    each = schema.get("prefixItems") or [schema.get("items") or {}]
    if any(item != each[0] for item in each):
        return None
    items = _plain_schema(each[0], defs, seen)
    return None if items is None or items["type"] == "array" else {"type": "array", "items": items}


def _plain_enum(values: list[int | str | None]) -> _Schema | None:
    kinds = {type(value) for value in values if value is not None}
    names: dict[type, str] = {int: "integer", str: "string"}
    return {"type": names[kinds.pop()]} if len(kinds) == 1 and kinds <= names.keys() else None
