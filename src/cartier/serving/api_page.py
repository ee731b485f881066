"""Page of the HTTP API, made of its OpenAPI document: plain HTML without scripts, which names no other machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

HEAD = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="data:,">
<title>cartier: HTTP API</title>
<link rel="stylesheet" href="/docs.css">
</head>
<body>
"""


def page(document: Mapping[str, Any]) -> str:
    """The page of an OpenAPI document."""
    info, schemas = document["info"], document["components"]["schemas"]
    parts = [HEAD, f"<h1>{escape(info['title'])} {escape(info['version'])}</h1>\n<p>{escape(info['summary'])}</p>\n"]
    parts.append('<p>For programs: <a href="/openapi.json">openapi.json</a>. What is wrong comes as one line, ')
    parts.append("<code>error</code>, with a status of 4xx.</p>\n")
    for path, methods in document["paths"].items():
        parts += [_operation(path, method, told) for method, told in methods.items()]
    parts.append("<h2>Values</h2>\n")
    parts += [_schema(name, schema) for name, schema in schemas.items()]
    return "".join([*parts, "</body>\n</html>\n"])


def _operation(path: str, method: str, told: Mapping[str, Any]) -> str:
    rows = [
        (value["name"], value["schema"], value.get("required", False), value["in"])
        for value in told.get("parameters", ())
    ]
    body = told.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema")
    answers = told["responses"]["200"].get("content", {})
    gives = ", or ".join(f"{_type(content.get('schema', {}))} as {escape(kind)}" for kind, content in answers.items())
    takes = f"<p>Takes {_type(body)} as application/json.</p>\n" if body else ""
    head = f"<h2><b>{method.upper()}</b> <code>{escape(path)}</code></h2>\n<p>{escape(told['summary'])}</p>\n"
    return f"<section>\n{head}{_table(rows)}{takes}<p>Gives {gives}.</p>\n</section>\n"


def _schema(name: str, schema: Mapping[str, Any]) -> str:
    required = schema.get("required", ())
    rows = [
        (field, value, field in required, value.get("description", ""))
        for field, value in schema.get("properties", {}).items()
    ]
    about = f"<p>{escape(schema['description'])}</p>\n" if "description" in schema else ""
    return f'<section id="{escape(name)}">\n<h3>{escape(name)}</h3>\n{about}{_table(rows)}</section>\n'


def _table(rows: list[tuple[str, Mapping[str, Any], bool, str]]) -> str:
    if not rows:
        return ""
    lines = (
        f"<tr><td><code>{escape(name)}</code>{'' if required else ' <i>optional</i>'}</td>"
        f"<td>{_type(schema)}</td><td>{escape(about)}</td></tr>\n"
        for name, schema, required, about in rows
    )
    return f"<table>\n{''.join(lines)}</table>\n"


def _type(schema: Mapping[str, Any]) -> str:
    """A type in words, with links to the schemas that it names."""
    if "$ref" in schema:
        name = escape(schema["$ref"].rpartition("/")[2])
        return f'<a href="#{name}">{name}</a>'
    if "anyOf" in schema:
        return " or ".join(_type(each) for each in schema["anyOf"])
    if "enum" in schema:
        return ", ".join(f"<code>{escape(str(value))}</code>" for value in schema["enum"])
    kind = escape(str(schema.get("format") or schema.get("type") or "any value"))
    if kind == "array":
        inside = [*schema.get("prefixItems", ())] or [schema.get("items", {})]
        return f"list of {', '.join(_type(each) for each in inside)}"
    return f"{kind}{''.join(_bounds(schema))}"


def _bounds(schema: Mapping[str, Any]) -> Iterator[str]:
    named = {"minimum": "from", "maximum": "to", "maxLength": "of at most"}
    yield from (f" {word} {schema[key]:g}" for key, word in named.items() if key in schema)
    yield " characters" if "maxLength" in schema else ""
