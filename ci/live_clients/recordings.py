"""What pyautd3 sent and what autd3's own emulator made of it, as test data.

The file has a row for each case: ``sent`` (period of 25 µs and bytes), ``changes`` (period, number
of the phases in ``phases``, pulse widths in 1/512 period) and ``refusals``. Bytes are compressed by
zlib, in base64.
"""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

from .environments import Environment

__all__ = ["record"]


def record(environment: Environment, program: Path, target: Path) -> None:
    """Write what the program of *environment* sends, and the emulator's answer, to *target*."""
    emulated = json.loads(environment.run(program, "emulate"))
    sent = json.loads(environment.run(program, "record"))
    cases = {name: _case(sent[name], emulated[name]) for name in emulated}
    rows = (f"{json.dumps(name)}: {json.dumps(case)}" for name, case in cases.items())
    target.write_text("{\n" + ",\n".join(rows) + "\n}\n")
    focus = b"".join(base64.b64decode(row["bytes"]) for row in sent["focus"][:-1])
    (target.parent / "focus.bin").write_bytes(focus)  # without its end, for docs/boards/autd3.md


def _case(sent: list[dict[str, Any]], emulated: dict[str, Any]) -> dict[str, Any]:
    known: list[str] = []
    changes, number = [], -1
    for change in emulated["changes"]:
        if "phases" in change:
            if change["phases"] not in known:
                known.append(change["phases"])
            number = known.index(change["phases"])
        changes.append([change["period"], number, change["widths"]])
    return {
        "periods": emulated["periods"],
        "refusals": emulated["refusals"],
        "sent": [[row["period"], _packed(row["bytes"])] for row in sent],
        "changes": changes,
        "phases": _packed(base64.b64encode(b"".join(map(base64.b64decode, known))).decode()),
    }


def _packed(text: str) -> str:
    return base64.b64encode(zlib.compress(base64.b64decode(text), 9)).decode()
