"""The name of each benchmark's row, which outlives a renamed test or module.

A mark gives it: ``@pytest.mark.row("field at {count} points")``. A row is compared with the row of
the same name in another commit, so a benchmark that begins to measure other work takes a new name.
"""

import re

#: Rows of the tests of commits whose benchmarks have no such mark, as f17889f7.
EARLIER = {
    "test_acquisition_against_a_wide_search": "fit of a focus without a hint",
    "test_arbitrary_points_against_numpy[{count}]": "field at {count} points",
    "test_arbitrary_points_against_the_arithmetic_limit[{count}]": (
        "field at {count} points, beside sgemm"
    ),
    "test_board_step[{frame}]": "board step, {frame}",
    "test_frame_against_crc32[{implementation}-{content}]": (
        "frame from a body, {content}, COBS in {implementation}"
    ),
    "test_message[{direction}-{message}]": "{direction} {message}",
    "test_reconstruction_against_double_precision": "reconstruction of a drive",
    "test_round_trip_of_both_connections": "PING and PONG through both connections",
    "test_sources_against_numpy[{shape}-{sources}]": "field of {sources} sources, {shape}",
    "test_stream_decoder_against_byte_by_byte[{implementation}-{content}]": (
        "decoder of a stream, {content}, COBS in {implementation}"
    ),
    "test_stream_frame_through_both_connections": "phase frame through both connections",
    "test_verify_in_virtual_time[{mode}]": "verification in virtual time, {mode}",
    "test_warm_fit_against_a_local_search": "fit of a focus from a hint",
    "test_weighted_gerchberg_saxton_against_numpy[{foci}]": (
        "weighted Gerchberg-Saxton, {foci} foci"
    ),
    "test_whole_frame_against_crc32[{content}]": "frame from a message, {content}",
}


def row_of(item):
    """Return the row of a collected test, None for one without the mark."""
    mark = item.get_closest_marker("row")
    if mark is None:
        return None
    return mark.args[0].format(**(item.callspec.params if hasattr(item, "callspec") else {}))


def repeated(names):
    """Return the names that occur more than once."""
    return sorted({name for name in names if names.count(name) > 1})


def row_of_result(entry):
    """Return the row of a result in the JSON of pytest-benchmark; None for a test without one."""
    if row := entry["extra_info"].get("row"):
        return row
    for test, row in EARLIER.items():
        if found := re.fullmatch(_pattern(test), entry["name"]):
            return row.format(**found.groupdict())
    return None


def _pattern(test):
    return re.sub(r"\\{(\w+)\\}", r"(?P<\1>[^-]+)", re.escape(test))
