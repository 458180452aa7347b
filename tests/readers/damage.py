"""What happens to any file: it is cut short, bits flip in it, it is lost, or something else stands in its place."""

from hypothesis import strategies as st

ANY = ("cut", "flip", "empty", "noise")


def of_any_file(draw: st.DrawFn, data: bytes, kind: str) -> bytes:
    """`data` with a damage of ANY."""
    if kind == "cut":
        return data[: draw(st.integers(0, len(data)))]
    if kind == "flip":
        found = bytearray(data)
        for bit in draw(st.lists(st.integers(0, 8 * len(data) - 1), min_size=1, max_size=8)):
            found[bit // 8] ^= 1 << bit % 8
        return bytes(found)
    return b"" if kind == "empty" else draw(st.binary(max_size=96))
