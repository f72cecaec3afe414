"""Files and folders of an object store that speaks S3: Amazon's, MinIO, Ceph and others.

Credentials and the address of the store are found as all tools of Amazon find them: variables of
the environment (``AWS_ACCESS_KEY_ID``, ``AWS_SECRET_ACCESS_KEY``, ``AWS_ENDPOINT_URL``), files in
``~/.aws``, the role of a machine. Where there are none the store is asked as the public may. None
is ever in a message: those of the library are left out.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import urlsplit

from silmesh.errors import InputError
from silmesh.remote.download import PATIENCE, PIECE, Answer, BrokenOffError, Source

ABSENT = ("404", "NoSuchKey", "NoSuchBucket", "NotFound")
CHANGED = ("412", "PreconditionFailed")
PAST_END = ("416", "InvalidRange")
AGAIN = ("500", "502", "503", "InternalError", "SlowDown", "ServiceUnavailable", "RequestTimeout")
FORBIDDEN = (
    *("401", "403", "AccessDenied", "InvalidAccessKeyId", "SignatureDoesNotMatch"),
    *("ExpiredToken", "InvalidToken", "AuthFailure"),
)


def bucket_file(url: str) -> Source:
    """A file of an object store: ``s3://<bucket>/<key>``."""
    bucket, key = _split(url)
    return lambda start, version: _ask(url, bucket, key, start, version)


def list_folder(url: str, most: int) -> list[str]:
    """The files that lie in a folder of an object store, not in folders of it: their addresses.

    Raises:
        InputError: there is none, or not for us, or there are more than ``most``
    """
    bucket, key = _split(url)
    prefix = f"{key.rstrip('/')}/"
    found: list[str] = []
    with _explaining(url):
        pages = _client().get_paginator("list_objects_v2")
        for page in pages.paginate(Bucket=bucket, Prefix=prefix, Delimiter="/"):
            keys = [entry["Key"] for entry in page.get("Contents", ()) if entry["Key"] != prefix]
            found += [f"s3://{bucket}/{name}" for name in keys]
            if len(found) > most:
                raise InputError(f"{url}: has more than {most:,} files; should be one object's")
    if not found:
        raise InputError(f"{url}: has no file; should be a folder of the bucket, or an archive")
    return found


def _split(url: str) -> tuple[str, str]:
    parts = urlsplit(url, allow_fragments=False)
    return parts.netloc, parts.path.lstrip("/")


def _ask(url: str, bucket: str, key: str, start: int, version: str) -> Answer:
    wanted = {"Range": f"bytes={start}-", "IfMatch": version} if start else {}
    with _explaining(url):
        from botocore.exceptions import ClientError

        try:
            given = _client().get_object(Bucket=bucket, Key=key, **wanted)
        except ClientError as error:
            if start and error.response["Error"]["Code"] in CHANGED + PAST_END:
                return _ask(url, bucket, key, 0, "")
            raise
    total = start + given["ContentLength"]
    return Answer(start, total, given["ETag"], _read(url, given["Body"]))


def _read(url: str, body: Any) -> Iterator[bytes]:
    with _explaining(url):
        yield from body.iter_chunks(PIECE)


@cache
def _client() -> Any:
    """A client by what this machine knows of credentials; one of the public if that is nothing."""
    import boto3
    from botocore import UNSIGNED
    from botocore.config import Config

    session = boto3.session.Session()
    known = session.get_credentials() is not None
    config = Config(
        signature_version=None if known else UNSIGNED,
        read_timeout=PATIENCE,
        retries={"max_attempts": 2, "mode": "standard"},
        response_checksum_validation="when_required",
    )
    return session.client("s3", config=config)


@contextmanager
def _explaining(url: str) -> Iterator[None]:
    """Make messages of ours of what the library says, which may hold what is secret."""
    from botocore.exceptions import (
        BotoCoreError,
        ClientError,
        ConnectionError,
        HTTPClientError,
        IncompleteReadError,
    )
    from urllib3.exceptions import HTTPError

    try:
        yield
    except ClientError as error:
        _refuse(url, str(error.response["Error"].get("Code", "")))
    except (ConnectionError, HTTPClientError, IncompleteReadError, HTTPError, OSError) as error:
        raise BrokenOffError(f"the store broke off ({type(error).__name__})") from error
    except BotoCoreError as error:
        raise InputError(
            f"{url}: cannot be asked for: {type(error).__name__}; {_say_credentials()}"
        ) from error


def _refuse(url: str, code: str) -> None:
    name = PurePosixPath(url).name
    if code in AGAIN:
        raise BrokenOffError(f"the store says {code}")
    if code in ABSENT:
        raise InputError(f"{url}: is not there ({code}); should be a bucket and what it has")
    if code in FORBIDDEN:
        raise InputError(
            f"{url}: the store does not give {name} ({code}): credentials are missing or wrong; "
            f"{_say_credentials()}"
        )
    raise InputError(f"{url}: the store says {code}")


def _say_credentials() -> str:
    return (
        "should be in AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or in ~/.aws, and "
        "AWS_ENDPOINT_URL should name a store that is not Amazon's"
    )
