"""Landlock of Linux (kernel 5.13 and later): forbid this process and its children to change files.

It restricts every user, root too; files that are already open stay writable. Source: the kernel's "Landlock:
unprivileged access control", user-space API.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from slamgauge.compare.estimators import namespaces

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # numbers of the system calls, on every processor
ASK_VERSION, PATH_BENEATH = 1, 1
WRITE_FILE, REMOVE, MAKE = 1 << 1, 0b11 << 4, 0b1111111 << 6
REFER, TRUNCATE = 1 << 13, 1 << 14  # since versions 2 and 3


def write_only_in(places: Iterable[Path]) -> None:
    """Allow writing, making and removing only these files, and those in these folders and below.

    Where the system cannot do that, nothing changes.
    """
    if not sys.platform.startswith("linux"):
        return
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(CREATE_RULESET, None, 0, ASK_VERSION)
    if version < 1:
        return
    rights = WRITE_FILE | REMOVE | MAKE | (REFER if version > 1 else 0) | (TRUNCATE if version > 2 else 0)
    attributes = struct.pack("Q", rights)
    rules = libc.syscall(CREATE_RULESET, attributes, len(attributes), 0)
    for place in places:
        if place.exists():
            opened = os.open(place, os.O_PATH | os.O_CLOEXEC)
            granted = rights if place.is_dir() else rights & (WRITE_FILE | TRUNCATE)
            libc.syscall(ADD_RULE, rules, PATH_BENEATH, struct.pack("=Qi", granted, opened), 0)
            os.close(opened)
    namespaces.control(namespaces.NO_NEW_PRIVILEGES, 1)
    libc.syscall(RESTRICT_SELF, rules, 0)
    os.close(rules)
