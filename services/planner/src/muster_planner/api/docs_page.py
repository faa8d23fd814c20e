"""The page at `/docs`: every call with what it takes and answers, written from the OpenAPI description.

The usual page loads its scripts from another host, which a site without a network does not reach.
"""

import html
import json
from collections.abc import Mapping
from typing import Any

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 56rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
code, pre { font-family: ui-monospace, monospace; font-size: .875rem; }
pre { background: #f4f4f2; padding: .75rem; overflow-x: auto; }
section { border-top: 1px solid #ccc; padding: .5rem 0; }
h2 { font-size: 1.1rem; } summary { cursor: pointer; } td, th { text-align: left; padding: .1rem 1rem .1rem 0; }
"""


def docs_page(openapi: Mapping[str, Any]) -> str:
    """Return the page for an OpenAPI description."""
    info = openapi["info"]
    calls = "".join(
        _call(method, path, call) for path, methods in openapi["paths"].items() for method, call in methods.items()
    )
    models = "".join(
        f"<details id='{_text(name)}'><summary><code>{_text(name)}</code></summary>{_json(model)}</details>"
        for name, model in openapi.get("components", {}).get("schemas", {}).items()
    )
    return (
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{_text(info['title'])}</title>"
        f"<style>{_STYLE}</style><h1>{_text(info['title'])} {_text(info['version'])}</h1>"
        f"<p>{_text(info.get('description', ''))}</p><p><a href='openapi.json'>openapi.json</a></p>"
        f"{calls}<h2>Models</h2>{models}</html>"
    )


def _call(method: str, path: str, call: Mapping[str, Any]) -> str:
    parameters = "".join(_row(f"{p['name']} ({p['in']})", p.get("description", "")) for p in call.get("parameters", []))
    bodies = "".join(_json(content["schema"]) for content in call.get("requestBody", {}).get("content", {}).values())
    answers = "".join(_row(status, answer.get("description", "")) for status, answer in call["responses"].items())
    return (
        f"<section><h2><code>{method.upper()} {_text(path)}</code> {_text(call.get('summary', ''))}</h2>"
        f"<p>{_text(call.get('description', ''))}</p>"
        + (f"<table>{parameters}</table>" if parameters else "")
        + (f"<p>Body:</p>{bodies}" if bodies else "")
        + f"<table>{answers}</table></section>"
    )


def _row(name: str, what: str) -> str:
    return f"<tr><td><code>{_text(name)}</code></td><td>{_text(what)}</td></tr>"


def _json(value: object) -> str:
    return f"<pre>{_text(json.dumps(value, indent=2))}</pre>"


def _text(value: object) -> str:
    return html.escape(str(value))
