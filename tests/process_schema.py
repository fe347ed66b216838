"""The structure of a process description of OGC API - Processes 1.0, as a JSON schema of our own.

Source: OGC 18-062r2, requirements class "OGC Process Description".
"""

from __future__ import annotations

from typing import Any

TEXT = {"type": "string", "minLength": 1}
VALUE_TYPES = ["array", "boolean", "integer", "number", "object", "string"]

# Keys that both OpenAPI 3.0 (OGC 1.0) and JSON Schema 2020-12 know with the same meaning.
DATA: dict[str, Any] = {
    "type": "object",
    "anyOf": [{"required": ["type"]}, {"required": ["oneOf"]}],
    "additionalProperties": False,
    "properties": {
        "type": {"enum": VALUE_TYPES},
        "oneOf": {"type": "array", "minItems": 2, "items": {"required": ["type"]}},
        "format": TEXT,
        "contentMediaType": TEXT,
        "pattern": {"type": "string", "format": "regex"},
        "enum": {"type": "array", "minItems": 1, "uniqueItems": True},
        "not": {
            "type": "object",
            "required": ["enum"],
            "additionalProperties": False,
            "properties": {"enum": {"type": "array", "minItems": 1}},
        },
        "minimum": {"type": "number"},
        "maximum": {"type": "number"},
        "minItems": {"type": "integer"},
        "maxItems": {"type": "integer"},
        "items": {"type": "object"},
        "default": {},
    },
}

METADATA = {
    "type": "array",
    "items": {
        "type": "object",
        "required": ["role", "value"],
        "additionalProperties": False,
        "properties": {"role": TEXT, "title": TEXT, "value": TEXT},
    },
}


def field(*, is_input: bool) -> dict[str, Any]:
    """An input or output; only inputs say how often they may occur."""
    properties = {"title": TEXT, "description": TEXT, "schema": DATA, "metadata": METADATA}
    occurs = (
        {"minOccurs": {"enum": [0, 1]}, "maxOccurs": {"enum": [1, "unbounded"]}} if is_input else {}
    )
    return {
        "type": "object",
        "required": ["title", "description", "schema", *occurs],
        "additionalProperties": False,
        "properties": properties | occurs,
    }


def named(fields: dict[str, Any], pattern: str = "^[a-z][a-z0-9_]*$") -> dict[str, Any]:
    """A mapping of names to fields, at least one."""
    return {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"pattern": pattern},
        "additionalProperties": fields,
    }


PROCESS: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "type": "object",
    "required": ["id", "version", "inputs", "outputs"],
    "additionalProperties": False,
    "properties": {
        "id": {"type": "string", "pattern": r"^[a-z]+(\.[a-z][a-z0-9_]*)+$"},
        "version": {"type": "string", "pattern": r"^\d+\.\d+\.\d+"},
        "title": TEXT,
        "description": TEXT,
        "keywords": {"type": "array", "items": TEXT},
        "metadata": METADATA,
        "jobControlOptions": {
            "type": "array",
            "items": {"enum": ["sync-execute", "async-execute", "dismiss"]},
        },
        "inputs": named(field(is_input=True)),
        "outputs": named(field(is_input=False)),
        # Ours, of models: the files that are handed over, and what each step gives, by step.output.
        "deliver": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["file", "output", "description"],
                "additionalProperties": False,
                "properties": {"file": TEXT, "output": TEXT, "description": TEXT},
            },
        },
        "between": named(field(is_input=False), pattern=r"^[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*$"),
    },
}
