"""The machine of a measurement: without it a figure says nothing."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path
from typing import Any, Final

import haptogram

_PACKAGES: Final = ("numpy", "scipy", "pyserial", "numba")
_PROC: Final = Path("/proc")
_CPU0: Final = Path("/sys/devices/system/cpu/cpu0")


def machine_fingerprint() -> dict[str, Any]:
    """Return CPU, kernel, governor, virtualisation, load and versions; no name of host or user."""
    return {
        "cpu": _machine_cpu_model(),
        "cpus": os.cpu_count(),
        "cpus_usable": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None,
        "kernel": _machine_kernel(),
        "preemption": _machine_preemption(),
        "governor": _read_machine_file(_CPU0 / "cpufreq/scaling_governor"),
        "clock_source": _read_machine_file(
            Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
        ),
        "virtualisation": _machine_virtualisation(),
        "load_1_min": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "python": _machine_python(),
        "haptogram": haptogram.__version__,
        "packages": {name: package_version(name) for name in _PACKAGES},
    }


def machine_text() -> str:
    """Return processor, number of processors, kernel and Python in a line."""
    count = os.cpu_count()
    processors = f"{count} processor{'' if count == 1 else 's'}"
    return ", ".join([_machine_cpu_model(), processors, _machine_kernel(), _machine_python()])


def fingerprint_cpu_times() -> dict[str, int]:
    """Return ticks of all processors since boot: busy, idle and stolen by the hypervisor."""
    words = _read_machine_file(_PROC / "stat")
    if words is None:
        return {}
    user, nice, system, idle, iowait, irq, softirq, steal = map(int, words.split()[1:9])
    busy = user + nice + system + irq + softirq
    return {"busy": busy, "idle": idle + iowait, "steal": steal}


def fingerprint_cpu_share(before: dict[str, int], after: dict[str, int]) -> dict[str, float]:
    """Return the shares of the processors' time that were busy, idle and stolen in between."""
    spent = {name: after[name] - before[name] for name in before if name in after}
    total = sum(spent.values())
    return {name: value / total for name, value in spent.items()} if total > 0 else {}


def _machine_cpu_model() -> str:
    """Return the processor's name, or its architecture where the system has no name."""
    text = _read_machine_file(_PROC / "cpuinfo") or ""
    names = (line.split(":", 1)[1].strip() for line in text.splitlines() if "model name" in line)
    return next(names, "") or platform.processor() or platform.machine()


def _machine_kernel() -> str:
    """Return name, release and architecture of the system."""
    return f"{platform.system()} {platform.release()} {platform.machine()}"


def _machine_python() -> str:
    """Return implementation and version of Python."""
    return f"{platform.python_implementation()} {platform.python_version()}"


def _machine_preemption() -> str | None:
    """Return the kernel's preemption model, such as PREEMPT_RT; None if it names none."""
    version = platform.version()
    found = [word for word in version.split() if word.startswith("PREEMPT")]
    return found[0] if found else None


def _machine_virtualisation() -> str | None:
    """Return "virtual machine", with its vendor, or "none"; None if it is not known."""
    if not sys.platform.startswith("linux"):
        return None
    text = _read_machine_file(_PROC / "cpuinfo") or ""
    if "hypervisor" not in text:
        return "none"
    vendor = _read_machine_file(Path("/sys/class/dmi/id/sys_vendor"))
    return f"virtual machine ({vendor})" if vendor else "virtual machine"


def _read_machine_file(path: Path) -> str | None:
    """Return the text of a file of the system; None if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None


def package_version(package: str) -> str | None:
    """Return the version of *package*; None: it is not installed."""
    import importlib.metadata  # 15 ms

    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
