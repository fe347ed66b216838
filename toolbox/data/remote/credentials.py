"""Keys for stores on the web, from where their own programs look for them.

Without any keys requests are not signed, as public data want it. Nothing of this is ever kept,
logged or shown.
"""

from __future__ import annotations

import configparser
import os
from pathlib import Path
from typing import Any

from toolbox.errors import DataError

_AWS_KEYS = (
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_SKIP_SIGNATURE",
)
_GOOGLE_KEYS = (
    "GOOGLE_APPLICATION_CREDENTIALS",
    "GOOGLE_BEARER_TOKEN",
    "GOOGLE_SERVICE_ACCOUNT",
    "GOOGLE_SERVICE_ACCOUNT_KEY",
    "GOOGLE_SERVICE_ACCOUNT_PATH",
    "GOOGLE_SKIP_SIGNATURE",
)
_GOOGLE_FILE = Path(".config/gcloud/application_default_credentials.json")
_AZURE_ACCOUNT = ("AZURE_STORAGE_ACCOUNT_NAME", "AZURE_STORAGE_USE_EMULATOR")
_AZURE_KEYS = (
    "AZURE_STORAGE_ACCOUNT_KEY",
    "AZURE_STORAGE_ACCESS_KEY",
    "AZURE_STORAGE_MASTER_KEY",
    "AZURE_STORAGE_SAS_KEY",
    "AZURE_STORAGE_SAS_TOKEN",
    "AZURE_STORAGE_TOKEN",
    "AZURE_STORAGE_CLIENT_ID",
    "AZURE_CLIENT_ID",
    "AZURE_FEDERATED_TOKEN_FILE",
    "AZURE_USE_AZURE_CLI",
    "AZURE_MSI_ENDPOINT",
    "AZURE_IDENTITY_ENDPOINT",
    "AZURE_STORAGE_USE_EMULATOR",
    "AZURE_SKIP_SIGNATURE",
)


def of(scheme: str) -> dict[str, Any]:
    """What a store is told beside what its library reads from the environment itself.

    Parameters
    ----------
    scheme : s3, gs or az

    Raises
    ------
    DataError
        An account must be named and is not.
    """
    return {"s3": _of_aws, "gs": _of_google, "az": _of_azure}[scheme]()


def is_true(variable: str) -> bool:
    """Whether a variable of the environment says yes."""
    return os.environ.get(variable, "").lower() in ("true", "1", "yes")


def _has(names: tuple[str, ...]) -> bool:
    return any(os.environ.get(name) for name in names)


def _of_google() -> dict[str, Any]:
    there = _has(_GOOGLE_KEYS) or (Path.home() / _GOOGLE_FILE).exists()
    return {} if there else {"skip_signature": True}


def _of_azure() -> dict[str, Any]:
    """Nothing where there are keys; the identity of a virtual machine counts if it is named."""
    if not _has(_AZURE_ACCOUNT):
        text = "for az://CONTAINER/FILE, name the account in AZURE_STORAGE_ACCOUNT_NAME"
        raise DataError(text)
    return {} if _has(_AZURE_KEYS) else {"skip_signature": True}


def _of_aws() -> dict[str, Any]:
    """Keys and region of the profile in ~/.aws, unless the environment has them."""
    if _has(_AWS_KEYS):
        return {}
    profile = os.environ.get("AWS_PROFILE", "default")
    aws = Path.home() / ".aws"
    files = {
        os.environ.get("AWS_SHARED_CREDENTIALS_FILE", aws / "credentials"): profile,
        os.environ.get("AWS_CONFIG_FILE", aws / "config"): (
            profile if profile == "default" else f"profile {profile}"
        ),
    }
    found: dict[str, Any] = {}
    for path, section in files.items():
        parser = configparser.ConfigParser(interpolation=None)
        parser.read(path, encoding="utf-8")
        if parser.has_section(section):
            names = ("access_key_id", "secret_access_key", "session_token")
            said = {name: parser.get(section, f"aws_{name}", fallback="") for name in names}
            said["region"] = parser.get(section, "region", fallback="")
            found |= {name: value for name, value in said.items() if value}
    return found if "access_key_id" in found else {**found, "skip_signature": True}
