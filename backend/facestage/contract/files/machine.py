"""What is said when the machine, not the program or its input, stands in the way."""

from __future__ import annotations

import errno
from collections.abc import Iterator

FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EFBIG)
FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)


def machine_trouble(error: BaseException) -> str | None:
    """One sentence for what the machine, not the program, is to blame for; None for anything
    else.
    """
    if isinstance(error, MemoryError):
        detail = f" ({error})" if str(error) else ""
        return (
            f"The memory is not enough for this{detail}; take a smaller photo or face "
            "model, or free some memory."
        )
    # Libraries hide a full disk behind errors of their own, raised while they close the file.
    cause = next(
        (one for one in _chain(error) if isinstance(one, OSError) and one.errno in FULL), error
    )
    if not isinstance(cause, OSError):
        return None
    file = f" '{cause.filename}'" if cause.filename else ""
    if cause.errno in FULL:
        remedy = "free some space, or choose another disk, and run it again"
        return f"Cannot write{file or ' the output'}: {cause.strerror or cause}; {remedy}."
    if cause.errno in FORBIDDEN:
        return (
            f"Cannot use{file or ' a file'}: {cause.strerror or cause}; check who may read "
            "and write there."
        )
    return (
        f"Cannot use{file or ' a file'}: {cause.strerror or cause}; check the path and the "
        "disk, and run it again."
    )


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__
