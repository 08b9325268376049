"""A remote store in an object store that speaks the S3 protocol. Needs boto3, which nothing else imports."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import boto3
from botocore.exceptions import BotoCoreError, ClientError

from minihuman.admin.remote_store import RemoteStore, RemoteStoreConflictError, RemoteStoreError
from minihuman.operating_system import replace_file

_CONFLICTS = ("PreconditionFailed", "ConditionalRequestConflict", "412", "409")


class S3Store(RemoteStore):
    """Objects of a bucket. The store's address, keys and region are boto3's to find: ``AWS_ENDPOINT_URL`` and the like.

    Args:
        where: the bucket, and what all names begin with: "bucket/prefix".
    """

    def __init__(self, where: str) -> None:
        self._bucket, _, prefix = where.partition("/")
        self._prefix = f"{prefix.rstrip('/')}/" if prefix else ""
        self._client = boto3.client("s3")

    def put(self, name: str, path: Path, *, over: str = "") -> None:
        """Send it, on the condition that the store has that version; the store shows it when all of it is there."""
        condition = {"IfMatch": f'"{over}"'} if over else {"IfNoneMatch": "*"}
        with self._said(f"{path} cannot be put into"), path.open("rb") as file:
            self._client.put_object(Bucket=self._bucket, Key=self._prefix + name, Body=file, **condition)

    def fetch(self, name: str, path: Path) -> None:
        """Get it, beside its place first."""
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        with self._said(f"{name} cannot be fetched from"):
            try:
                self._client.download_file(self._bucket, self._prefix + name, str(beside))
                replace_file(beside, path)
            finally:
                beside.unlink(missing_ok=True)

    def versions(self, prefix: str) -> dict[str, str]:
        """The objects' entity tags, page by page."""
        with self._said("nothing can be listed of"):
            pages = self._client.get_paginator("list_objects_v2").paginate(
                Bucket=self._bucket, Prefix=self._prefix + prefix
            )
            found = [one for page in pages for one in page.get("Contents", ())]
        return {one["Key"].removeprefix(self._prefix): one["ETag"].strip('"') for one in found}

    def remove(self, name: str) -> None:
        """Delete it."""
        with self._said(f"{name} cannot be removed from"):
            self._client.delete_object(Bucket=self._bucket, Key=self._prefix + name)

    @contextmanager
    def _said(self, what: str) -> Iterator[None]:
        try:
            yield
        except (BotoCoreError, ClientError) as error:
            if isinstance(error, ClientError) and error.response["Error"].get("Code") in _CONFLICTS:
                raise RemoteStoreConflictError(
                    f"{what} {self._bucket}, as another machine has just changed it; run the command again"
                ) from error
            raise RemoteStoreError(f"{what} {self._bucket}: {error}") from error
