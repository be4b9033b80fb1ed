"""Checks at the start of a service which layers of the children's sandbox (``sandbox``) are available."""

import os
import pwd
import stat
import sys
from pathlib import Path

import structlog

from stridelab.errors import InvalidInput
from stridelab.service.processes.sandbox import LAYERS, KernelFeatures, missing_layers_error
from stridelab.service.settings import Settings

_log = structlog.get_logger(__name__)


def active_layers(settings: Settings) -> tuple[str, ...]:
    """Active layers of the sandbox: those of ``LAYERS`` that the kernel supports."""
    return () if settings.sandbox == "off" else KernelFeatures.detect_features().supported_layers


def check_sandbox_settings(settings: Settings) -> None:
    """Check the sandbox settings.

    Raises ``Unavailable`` (``sandbox-missing``) if a layer is missing and all are required, ``InvalidInput``
    (``child-user-unknown``).
    """
    if settings.sandbox == "required" and (missing := _missing_layers(settings)):
        raise missing_layers_error(missing)
    if settings.child_user is not None:
        _user_account(settings.child_user)


def prepare_confinement(settings: Settings, *folders: Path) -> None:
    """Log a warning if the sandbox lacks a layer, and give the children's account access to ``folders``.

    Raises as ``check_sandbox_settings`` does, and ``InvalidInput`` (``child-user-cannot-reach``).
    """
    check_sandbox_settings(settings)
    there, missing = active_layers(settings), _missing_layers(settings)
    if missing:
        why = (
            "STRIDELAB_SANDBOX=off" if settings.sandbox == "off" else "the kernel or the container does not offer them"
        )
        _log.warning("sandbox-incomplete", active=list(there), missing=list(missing), why=why)
    if settings.child_user is not None and os.geteuid() == 0:
        code = Path(__file__)
        grant_search_access(settings.child_user, *folders)
        for needed in (*folders, code, Path(sys.prefix), Path(sys.base_prefix)):
            _require_reachable(settings.child_user, needed)


def grant_search_access(user: str, *folders: Path) -> None:
    """Give the group of ``user`` search permission on ``folders`` without permission to list them.

    Raises ``InvalidInput`` (``child-user-unknown``).
    """
    account = _user_account(user)
    for folder in folders:
        if not _has_search_access(account, folder):
            os.chown(folder, -1, account.pw_gid)
            folder.chmod(stat.S_IMODE(folder.stat().st_mode) & ~0o070 | 0o010)


def _missing_layers(settings: Settings) -> tuple[str, ...]:
    there = active_layers(settings)
    return tuple(name for name in LAYERS if name not in there)


def _require_reachable(user: str, path: Path) -> None:
    account = _user_account(user)
    for folder in path.resolve().parents:
        if not _has_search_access(account, folder):
            raise InvalidInput(
                "child-user-cannot-reach",
                f"STRIDELAB_CHILD_USER: {user} may not pass through {folder}, which leads to {path}. Install "
                "the program and its data where every account may look (such as /opt and /srv), or unset the variable.",
            )


def _has_search_access(account: pwd.struct_passwd, folder: Path) -> bool:
    facts = folder.stat()
    if facts.st_uid == account.pw_uid:
        return bool(facts.st_mode & stat.S_IXUSR)
    if facts.st_gid == account.pw_gid:
        return bool(facts.st_mode & stat.S_IXGRP)
    return bool(facts.st_mode & stat.S_IXOTH)


def _user_account(user: str) -> pwd.struct_passwd:
    try:
        return pwd.getpwnam(user)
    except KeyError:
        raise InvalidInput("child-user-unknown", f"STRIDELAB_CHILD_USER: there is no account {user}.") from None
