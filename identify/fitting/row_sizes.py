"""To how many rows a test's readings are padded, so that records of similar length share compiled programs. No JAX."""


def padded_size(rows: int) -> int:
    """The next of a few sizes, at most an eighth above the number of rows."""
    if rows <= 64:
        return 64
    step = 2 ** (int(rows - 1).bit_length() - 4)
    return -(-rows // step) * step


def coarse_size(rows: int) -> int:
    """The next of fewer sizes, at most a half above the number of rows: for programs that take long to compile."""
    if rows <= 256:
        return 256
    power = 1 << (int(rows - 1).bit_length() - 1)
    return power + power // 2 if rows <= power + power // 2 else 2 * power
