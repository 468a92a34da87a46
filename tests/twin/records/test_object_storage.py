"""Who asks an object storage, and what is said when it does not answer: one line, and soon."""

import contextlib
import os
import re
import socket
import sys
import time
from pathlib import Path

import pytest
from processes import python
from s3 import PACKAGES, s3_server

from twin.errors import InputError
from twin.records.storage import object_storage
from twin.records.storage.object_storage import ObjectFiles
from twin.records.storage.store_path import Url, files_at, store_path

pytest.importorskip("obstore", reason='needs pip install "glider-twin[cloud]"')

ROOT = Path(__file__).resolve().parents[3]
KEYS = {
    "AWS_ACCESS_KEY_ID": "a",
    "AWS_SECRET_ACCESS_KEY": "b",
    "AWS_REGION": "us-east-1",
    "AWS_ALLOW_HTTP": "true",
}
SOON_S = 150.0
"""[s] The library's own patience is 180 s"""


@pytest.fixture(autouse=True)
def _nothing_in_the_environment(monkeypatch, tmp_path):
    for name in os.environ:
        if name.startswith(("AWS_", "GOOGLE_", "AZURE_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    object_storage._meet.cache_clear()
    object_storage._read_profile.cache_clear()
    yield
    object_storage._meet.cache_clear()
    object_storage._read_profile.cache_clear()


def told(address, error):
    """What reading below an address says, in one line and soon."""
    begun = time.monotonic()
    with pytest.raises(error) as found:
        files_at(address).read("zarr.json")
    assert time.monotonic() - begun < SOON_S
    text = str(found.value)
    assert "\n" not in text
    assert len(text) < 400
    return text


def with_environment(monkeypatch, values):
    for name, text in values.items():
        monkeypatch.setenv(name, text)


def test_a_missing_bucket_and_a_missing_object_differ(monkeypatch):
    with s3_server() as environment:
        with_environment(monkeypatch, environment)
        assert "the storage has no bucket 'absent'" in told("s3://absent/m", NotADirectoryError)
        assert "s3://bucket/m/zarr.json" in told("s3://bucket/m", FileNotFoundError)
        monkeypatch.delenv("AWS_ALLOW_HTTP")
        object_storage._meet.cache_clear()
        assert "needs AWS_ALLOW_HTTP=true" in told("s3://bucket/m", PermissionError)


def test_a_wrong_key_is_told(monkeypatch):
    with s3_server(signed=True) as environment:
        with_environment(monkeypatch, environment)
        text = told("s3://bucket/m", PermissionError)
        assert re.search(r"the storage refuses .*403 Forbidden.*set AWS_ACCESS_KEY_ID", text)
        with pytest.raises(PermissionError, match="the storage refuses"):
            files_at("s3://bucket/m").write("a", b"1")


@pytest.mark.parametrize(
    ("answer", "let_in"), [("403 Forbidden", True), ("error sending request", False)]
)
def test_who_may_not_list_may_read(monkeypatch, answer, let_in):
    def refuse(*_, **__):
        raise OSError(answer)

    monkeypatch.setattr("obstore.list", refuse)
    monkeypatch.setattr(object_storage, "_open", lambda *_: None)
    object_storage._meet.cache_clear()
    bucket = store_path("s3://bucket/m")
    assert isinstance(bucket, Url)
    with contextlib.nullcontext() if let_in else pytest.raises(OSError, match="cannot be reached"):
        object_storage._meet(bucket)
    object_storage._meet.cache_clear()


@pytest.mark.parametrize("host", ["127.0.0.1:9", "storage.invalid"])
def test_a_storage_that_nobody_reaches_is_told(monkeypatch, host):
    with_environment(monkeypatch, {**KEYS, "AWS_ENDPOINT_URL": f"http://{host}"})
    monkeypatch.setenv("no_proxy", host)
    assert f"cannot be reached (GET http://{host}" in told("s3://bucket/m", OSError)


def test_a_storage_that_never_answers_is_told(monkeypatch):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"http://127.0.0.1:{silent.getsockname()[1]}"
        with_environment(monkeypatch, {**KEYS, "AWS_ENDPOINT_URL": address, "AWS_TIMEOUT": "1s"})
        assert "cannot be reached" in told("s3://bucket/m", OSError)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ("Error performing PUT http://169.254.169.254/latest/api/token", "set AWS_ACCESS_KEY_ID"),
        ("Error performing GET http://metadata.google.internal/x", "GOOGLE_APPLICATION_CRED"),
    ],
)
def test_who_has_no_key_is_told_which_variables_there_are(words, hint):
    """As obstore says it after asking the service of a cloud's machines in vain."""
    place = "s3://b/m" if "AWS" in hint else "gs://b/m"
    found = object_storage.explained(ValueError(f"Generic error: {words}\n\nDebug:"), place)
    assert isinstance(found, PermissionError)
    assert hint in str(found)


def test_google_and_azure_have_their_own_variables(monkeypatch, tmp_path):
    """Without servers: the address and the environment reach obstore's stores."""
    from obstore.store import AzureStore, GCSStore

    assert "AZURE_STORAGE_ACCOUNT_NAME" in told("az://box/m", InputError)
    monkeypatch.setenv("GOOGLE_APPLICATION_CREDENTIALS", str(tmp_path / "none.json"))
    text = told("gs://bucket/m", InputError)
    assert "none.json" in text
    assert "GOOGLE_APPLICATION_CREDENTIALS" in text
    monkeypatch.delenv("GOOGLE_APPLICATION_CREDENTIALS")
    with_environment(
        monkeypatch, {"AZURE_STORAGE_ACCOUNT_NAME": "account", "AZURE_STORAGE_ACCOUNT_KEY": "a2V5"}
    )
    retry = {"max_retries": 0}
    azure = object_storage._open(Url("az://box/folder/m.zarr"), retry)
    assert isinstance(azure, AzureStore)
    assert (azure.config["container_name"], azure.prefix) == ("box", "folder/m.zarr")
    google = object_storage._open(Url("gs://bucket/folder/m.zarr"), retry)
    assert isinstance(google, GCSStore)
    assert (google.config["bucket"], google.prefix) == ("bucket", "folder/m.zarr")


def test_a_profile_without_boto3_is_told(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "boto3", None)
    monkeypatch.setenv("AWS_PROFILE", "mine")
    text = told("s3://bucket/m", InputError)
    assert text.startswith("AWS_PROFILE=mine needs the package boto3")
    assert 'pip install "glider-twin[aws]"' in text
    monkeypatch.delenv("AWS_PROFILE")
    (tmp_path / ".aws").mkdir()
    (tmp_path / ".aws/credentials").write_text("[default]\n")
    assert told("s3://bucket/m", InputError).startswith("the profile in ~/.aws/credentials needs")
    with_environment(monkeypatch, {**KEYS, "AWS_ENDPOINT_URL": "http://127.0.0.1:9"})
    assert "cannot be reached" in told("s3://bucket/m", OSError)  # a key goes before profiles


def test_a_profile_gives_keys_region_and_endpoint(tmp_path):
    """With boto3, which may be in the environment of the server only."""
    with s3_server() as environment:
        folder = tmp_path / ".aws"
        folder.mkdir()
        (folder / "credentials").write_text(
            "[mine]\naws_access_key_id = test\naws_secret_access_key = test\n"
        )
        endpoint = environment["AWS_ENDPOINT_URL"]
        (folder / "config").write_text(
            f"[profile mine]\nregion = us-east-1\nendpoint_url = {endpoint}\n"
        )
        program = (
            "from twin.records.storage.store_path import files_at\n"
            "files = files_at('s3://bucket/profile')\n"
            "files.write('a', b'1')\n"
            "print(files.read('a'), list(files.all_keys()))\n"
        )
        base = {
            **os.environ,
            "PYTHONPATH": f"{ROOT}{os.pathsep}{PACKAGES}",
            "HOME": str(tmp_path),
            "AWS_ALLOW_HTTP": "true",
        }
        for name, code, said in (
            ("mine", 0, "b'1' ['a']"),
            ("yours", 1, r"AWS_PROFILE=yours gives no credentials \(.*yours.*\): set AWS_ACCESS"),
        ):
            done = python("-c", program, env=base, AWS_PROFILE=name)
            assert done.returncode == code, done.stderr
            assert re.search(re.escape(said) if not code else said, done.stdout + done.stderr)


def test_without_obstore_an_address_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(InputError, match=r"needs the package obstore.*glider-twin\[cloud\]"):
        ObjectFiles(Url("s3://bucket/m"))
