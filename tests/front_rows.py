"""Rows of a sweep, as its files have them, for tests of what reads these."""


def error(percent: float, kelvin: float = 1.0, p99: float = 2.0) -> dict:
    return {
        "rms_percent": [percent / 2, percent],
        "rms_kelvin": [kelvin / 2, kelvin],
        "p99_kelvin": [p99, p99],
    }


def row(name: str, load: str, percent: float, **fields) -> dict:
    defaults = {"id": f"{name}{load}", "choice": {"structure": name}, "load": load}
    defaults |= {"set": {}, "error": error(percent), "own_error": {}, "nodes": 10}
    return {
        **defaults,
        "links": 5,
        "steps": 3,
        "memory_bytes": 100,
        "picture": None,
        **fields,
    }


def time(name: str, load: str, seconds: float, **fields) -> dict:
    spans = [seconds, 2 * seconds, 0.9 * seconds]
    defaults = {"id": f"{name}{load}", "loop_s": spans, "processor": "a processor"}
    return {**defaults, "full_volume_loop_s": [8.0, 16.0, 9.0], **fields}
