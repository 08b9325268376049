"""A folder that serves a study: every file is read by a parser, and says what the study needs."""

import asyncio
import configparser
import json
import os
import re
import shlex
import shutil
import stat
import subprocess
from pathlib import Path
from types import SimpleNamespace

import click
import msgspec
import pytest
import yaml
from starlette.testclient import TestClient
from websockets.asyncio.server import serve

from minihuman.cli.command_line import make_command_line
from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.storage.remote_store import STORE_URL_FILE_NAME
from minihuman.storage.study_journals import URL_FILE_NAME
from minihuman.web.arrivals import Arrivals
from minihuman.web.deployment import Deployment, check, write_deployment
from minihuman.web.deployment.check import CheckResult, DeploymentCheckError, check_deployment
from minihuman.web.server.app import WebServer
from tests.counts import PATIENCE_S, count
from tests.lab.database import database, fresh
from tests.lab.object_store import object_store
from tests.machine import needs

PROTOCOL = Path(__file__).parents[2] / "protocols" / "online.toml"
ADDRESS = "https://study.example.org"
ALONE = Deployment(ADDRESS)
WHOLE = Deployment(ADDRESS, workers=3, postgres=True, bucket="s3://logs/online")


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    study = decode_protocol(PROTOCOL.read_bytes())
    out = {}
    for name, deployment in (("alone", ALONE), ("whole", WHOLE)):
        out[name] = tmp_path_factory.mktemp(name) / "folder"
        assert {path.exists() for path in write_deployment(study, out[name], deployment)} == {True}
    return out


def _served(words):
    """What our own command line makes of the words behind `minihuman`."""
    assert words[0].endswith("minihuman")
    assert words[1] == "serve"
    command = make_command_line().get_command(click.Context(click.Group()), "serve")
    return command.make_context("serve", list(words[2:]), resilient_parsing=False).params


@pytest.mark.parametrize(("name", "workers"), [("alone", 1), ("whole", 3)])
def test_container_and_unit_start_the_server_with_options_that_there_are(folders, name, workers, monkeypatch):
    monkeypatch.chdir(folders[name])
    text = (folders[name] / "Containerfile").read_text()
    started = [json.loads(re.search(r"^CMD (.*)$", text, re.MULTILINE)[1])]
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read(folders[name] / "minihuman.service")
    started.append(shlex.split(unit["Service"]["ExecStart"]))
    for words in started:
        params = _served(words)
        assert (str(params["protocol"]), params["links"], params["workers"]) == ("study.toml", 0, workers)
        assert params["address"] == ADDRESS
    assert unit["Install"]["WantedBy"] == "multi-user.target"
    assert re.findall(r"^COPY ([^\[]\S*)", text, re.MULTILINE) == ["minihuman*.whl"]
    copied = [json.loads(line) for line in re.findall(r"^COPY (\[.*)$", text, re.MULTILINE)]
    assert all((folders[name] / source).is_file() and source == target for source, target in copied)
    assert (folders[name] / "study.toml").read_bytes() == PROTOCOL.read_bytes()


def test_compose_has_the_services_that_were_asked_for(folders):
    alone, whole = (yaml.safe_load((folders[name] / "compose.yaml").read_text()) for name in ("alone", "whole"))
    assert alone["services"].keys() == {"study", "caddy"}
    assert whole["services"].keys() == {"study", "caddy", "postgres"}
    for compose in (alone, whole):
        assert compose["services"]["caddy"]["network_mode"] == "service:study"
        named = {mount.partition(":")[0] for one in compose["services"].values() for mount in one.get("volumes", ())}
        assert {name for name in named if not name.startswith("./")} == compose["volumes"].keys()
    mounted = {mount.split(":")[0] for one in whole["services"].values() for mount in one["volumes"] if mount[0] == "."}
    assert all((folders["whole"] / mount).is_file() for mount in mounted)
    assert {"./register.url", "./logs.url"} <= mounted
    assert not {"register.url", "logs.url", ".env"} & {path.name for path in folders["alone"].iterdir()}
    password = whole["services"]["postgres"]["environment"]["POSTGRES_PASSWORD"]
    assert whole["services"]["study"]["environment"]["PGPASSWORD"] == password


def test_a_file_whose_name_has_a_space_is_copied(tmp_path):
    picture = (PROTOCOL.parents[1] / "docs/images/paths.png").read_bytes()
    study = decode_protocol(PROTOCOL.read_bytes())
    study = msgspec.structs.replace(study, files={**study.files, "our maze.png": picture})
    write_deployment(study, tmp_path / "out", ALONE)
    copied = re.findall(r"^COPY (\[.*)$", (tmp_path / "out/Containerfile").read_text(), re.MULTILINE)
    assert [json.loads(line) for line in copied] == [["our maze.png"] * 2, ["study.toml"] * 2]


def test_an_update_installs_the_new_wheel_alone(folders, tmp_path):
    """The README's commands and the container file's installation, with programs that only say what they were given."""
    folder = tmp_path / "folder"
    shutil.copytree(folders["alone"], folder)
    (folder / "minihuman-0.1.0-py3-none-any.whl").touch()
    new = "minihuman_lab-0.2.0-py3-none-any.whl"
    programs = tmp_path / "programs"
    programs.mkdir()
    for name, line in (("python", f"touch '{folder}/{new}'"), ("docker", "true"), ("pip", 'printf "%s\\n" "$@"')):
        (programs / name).write_text(f"#!/bin/sh\n{line}\n")
        (programs / name).chmod(0o755)
    readme = (folder / "README.md").read_text().replace("FOLDER", shlex.quote(str(folder)))
    path = {"PATH": f"{programs}:{os.environ['PATH']}"}
    subprocess.run(["sh", "-ec", "\n".join(re.findall(r"^    (.*)", readme, re.MULTILINE))], env=path, check=True)
    text = (folder / "Containerfile").read_text().replace("/tmp/", f"{folder}/")
    (installing,) = re.findall(r"^RUN (set --(?:.*\\\n)*.*)$", text, re.MULTILINE)
    done = subprocess.run(["sh", "-c", installing], env=path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["install", "--no-cache-dir", f"{folder}/{new}[web]"]
    for one in ("minihuman-0.1.0-py3-none-any.whl", new):
        (folder / one).touch()
    refused = subprocess.run(["sh", "-c", installing], env=path, capture_output=True, text=True, check=False)
    assert refused.stderr == "2 wheels of minihuman are in this folder; remove all but the newest\n"
    assert refused.returncode == 1


@needs("caddy")
@pytest.mark.parametrize("name", ["alone", "whole"])
def test_caddy_reads_its_file_and_routes_sockets_alone_to_one_worker_each(folders, name):
    said = subprocess.run(
        ["caddy", "adapt", "--config", folders[name] / "Caddyfile"], capture_output=True, text=True, check=True
    )
    (server,) = json.loads(said.stdout)["apps"]["http"]["servers"].values()
    assert server["read_header_timeout"] == 10_000_000_000
    assert server["routes"][0]["match"] == [{"host": ["study.example.org"]}]
    routes = server["routes"][0]["handle"][0]["routes"]
    proxies = [(route.get("match"), route["handle"][0]) for route in routes]
    assert proxies.pop(0) == ([{"path": ["/metrics"]}], {"handler": "static_response", "status_code": 404})
    ports = (8000, 8001, 8002) if name == "whole" else (8000,)
    for _, proxy in proxies:
        assert [one["dial"] for one in proxy["upstreams"]] == [f"127.0.0.1:{port}" for port in ports]
    policies = [(match, proxy["load_balancing"]["selection_policy"]["policy"]) for match, proxy in proxies]
    sockets = [([{"path": ["/socket"]}], "uri_hash")] if name == "whole" else []
    assert policies == [*sockets, (None, "first")]
    assert proxies[-1][1]["load_balancing"]["try_duration"] == 30_000_000_000


def test_a_second_time_keeps_the_password_which_only_its_owner_reads(folders):
    secret = folders["whole"] / ".env"
    before = secret.read_bytes()
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    write_deployment(decode_protocol(PROTOCOL.read_bytes()), folders["whole"], WHOLE)
    assert secret.read_bytes() == before
    password = before.partition(b"=")[2].strip()
    assert [path.name for path in folders["whole"].iterdir() if password in path.read_bytes()] == [".env"]


@pytest.mark.parametrize("address", ["study.example.org", "http://study.example.org", f"{ADDRESS}/a", f"{ADDRESS}:444"])
def test_an_address_that_caddy_cannot_answer_is_refused(address):
    with pytest.raises(ProtocolError, match=r"--address .* is not valid; use https:// and a host"):
        Deployment(address)
    with pytest.raises(ProtocolError, match="--bucket 'logs' is not valid; use s3:// and a bucket"):
        Deployment(ADDRESS, bucket="logs")


def test_a_study_with_a_trained_agent_brings_what_plays_it(tmp_path):
    study = decode_protocol(PROTOCOL.with_name("teach-fourrooms.toml").read_bytes())
    write_deployment(study, tmp_path, ALONE)
    assert "[web,learn]" in (tmp_path / "Containerfile").read_text()


@pytest.mark.nightly
@pytest.mark.program
@needs("postgresql")
def test_a_check_restarts_and_kills_servers_and_finds_everything_that_was_acknowledged(tmp_path, monkeypatch):
    people, said = count(6, 300), []
    monkeypatch.setattr(check, "_KEY_PERIOD_S", count(1, 4) / 2)  # 40 presses each: they outlast the restarts
    with database() as url, object_store() as store:
        (tmp_path / URL_FILE_NAME).write_text(f"{fresh(url)}\n")
        (tmp_path / STORE_URL_FILE_NAME).write_text(f"{store}/{tmp_path.name}\n")
        result = check_deployment(tmp_path, people, on_progress=said.append)
    assert result.passed, result
    assert (result.participants, result.complete, result.lost, result.twice) == (people, people, 0, 0)
    assert [line.split(",")[0] for line in said[1:]] == [
        "server 1 restarted",
        "server 2 restarted",
        "server 1 killed",
    ]
    assert result.acknowledged > 10 * people
    assert result.moved
    assert result.interrupted


@pytest.mark.parametrize("wrong", ["complete", "lost", "twice", "differences"])
def test_a_check_with_anything_amiss_has_not_passed(wrong):
    fine = {"participants": 3, "complete": 3, "interrupted": 3, "moved": 1, "acknowledged": 40}
    assert CheckResult(**fine, lost=0, twice=0, differences=0).passed
    amiss = {"lost": 0, "twice": 0, "differences": 0, wrong: 1}
    assert not CheckResult(**{**fine, **amiss}).passed


@pytest.mark.parametrize("times_out", [False, True])
def test_a_check_whose_participants_are_all_refused_ends_and_says_so(times_out, monkeypatch):
    async def refuse(socket):
        await socket.recv()
        await socket.send(json.dumps({"t": "wait"} if times_out else {"t": "refused", "reason": "full"}))
        await socket.wait_closed()

    async def play():
        async with serve(refuse, "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            return await check._play_study([SimpleNamespace(host=f"127.0.0.1:{port}")], ["a", "b"], print)

    monkeypatch.setattr(check, "_TIMEOUT_S", 2.0 if times_out else PATIENCE_S)
    said = "{'not within 2 s': 2}" if times_out else "{'full': 2}"
    with pytest.raises(DeploymentCheckError, match=re.escape(said)):
        asyncio.run(play())


def test_a_check_without_a_database_names_the_file_that_it_needs(tmp_path):
    with pytest.raises(DeploymentCheckError, match=r"register\.url does not exist; write the address into it"):
        check_deployment(tmp_path, 1)


def test_the_kubernetes_manifest_starts_what_there_is_and_keeps_what_has_to_stay(tmp_path):
    docs = PROTOCOL.parents[1] / "docs"
    kinds = {one["kind"]: one for one in yaml.safe_load_all((docs / "kubernetes.yaml").read_text())}
    assert kinds.keys() == {"StatefulSet", "Service", "PodDisruptionBudget", "Ingress"}
    pod = kinds["StatefulSet"]["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    params = _served(container["args"])
    assert (params["links"], params["address"], params["host"]) == (0, ADDRESS, "0.0.0.0")
    assert container["ports"] == [{"name": "http", "containerPort": params["port"]}]
    page = TestClient(WebServer(Arrivals(decode_protocol(PROTOCOL.read_bytes()), tmp_path), tmp_path).app())
    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
        assert page.get(container[probe]["httpGet"]["path"]).text == "ok\n"
    data = f"/study/{params['data']}"
    mounted = {one["mountPath"]: one["name"] for one in container["volumeMounts"]}
    volumes = {one["metadata"]["name"] for one in kinds["StatefulSet"]["spec"]["volumeClaimTemplates"]}
    volumes |= {one["name"] for one in pod["volumes"]}
    assert set(mounted.values()) == volumes
    assert {data, f"{data}/{URL_FILE_NAME}", f"{data}/{STORE_URL_FILE_NAME}"} <= mounted.keys()
    labels = kinds["StatefulSet"]["spec"]["template"]["metadata"]["labels"]
    assert kinds["Service"]["spec"]["selector"] == labels
    assert kinds["PodDisruptionBudget"]["spec"]["selector"]["matchLabels"] == labels
    (rule,) = kinds["Ingress"]["spec"]["rules"]
    assert rule["host"] == ADDRESS.removeprefix("https://")
    assert rule["http"]["paths"][0]["backend"]["service"]["name"] == kinds["Service"]["metadata"]["name"]
    assert re.search(r"@sha256:[0-9a-f]{64}$", container["image"]), "an image is named by its digest"
