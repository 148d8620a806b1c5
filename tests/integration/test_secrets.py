"""No token is found anywhere but where it belongs: not in what the services print, not in a file of theirs."""

import os
import shutil
import sqlite3

import httpx

from tests.integration.farm_process import PATIENCE_S, ROOT, services, small_policy
from tests.integration.forked import Forked

GIVEN = {"admin_token": "trifarm_boss_" + "4dm1n" * 8, "robot_token": "trifarm_lab_" + "r0b0t" * 8}


def asked_wrongly(farm, bearer):
    """Every way in which people send a token to where it should not be."""
    secret = bearer.split("_", 2)[2]
    client = httpx.Client(base_url=farm.api)
    places = [f"/v1/jobs?token={bearer}", f"/v1/jobs/{bearer}", f"/v1/tokens/{bearer}", f"/{bearer}", f"/v1/trials/{secret}/log"]
    for method in ("GET", "POST", "DELETE"):
        for place in places:
            for headers in (
                {},
                {"Authorization": f"Bearer {bearer}x"},
                {"Authorization": bearer},
                {"Authorization": f"Basic {bearer}"},
            ):
                client.request(method, place, headers=headers)
            farm.admin.request(method, place)
    client.get("/v1/jobs", headers={"X-Token": bearer, "Cookie": f"token={bearer}", "X-Request-Id": bearer, "Referer": bearer})
    client.get("/v1/jobs", headers={"Authorization": f"Bearer {bearer}".replace("_", " ")})
    client.request(secret.upper()[:20], "/v1/jobs")  # a method
    farm.admin.post("/v1/jobs", json={"policy": bearer, "task": bearer, bearer: 1})
    farm.admin.post("/v1/jobs", content=bearer.encode())
    farm.admin.post("/v1/tokens", json={"owner": bearer + "!", "scopes": [bearer]})
    farm.admin.get("/v1/jobs", params={"cursor": bearer, "state": bearer})
    client.close()


def test_tokens_are_in_no_output_and_in_no_file(tmp_path):
    with services(tmp_path / "farm", anonymous_requests_per_s=0, **GIVEN) as farm:
        made = farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json()
        own = farm.client(GIVEN["robot_token"]).post("/v1/robots/robot-0/token").json()
        bearers = [*GIVEN.values(), made["secret"], own["secret"]]
        ann, robot = farm.client(made["secret"]), farm.client(own["secret"])
        assert farm.upload(*small_policy(), client=ann).status_code == 201
        assert robot.get("/v1/status").status_code == 200
        for bearer in [*bearers, "trifarm_wr0ng_" + "n0b0dy" * 8]:
            asked_wrongly(farm, bearer)
        # What goes wrong inside is told with its trace, and must not tell more than that.
        shutil.rmtree(farm.data / "files" / "incoming")
        assert farm.upload(*small_policy(seed=3), client=ann).status_code == 500
        with sqlite3.connect(farm.data / "farm.sqlite") as connection:
            connection.execute("ALTER TABLE token RENAME TO elsewhere")
        assert httpx.get(f"{farm.api}/v1/jobs", headers={"Authorization": f"Bearer {made['secret']}x"}).status_code == 503
        with sqlite3.connect(farm.data / "farm.sqlite") as connection:
            connection.execute("ALTER TABLE elsewhere RENAME TO token")
        connection.close()
        farm.admin.delete(f"/v1/tokens/{made['token_id']}")
        assert ann.post("/v1/jobs", json={}).status_code == 401
    said = farm.errors.read_text()
    assert said.count('"event": "audit"') > 100
    assert '"event": "unexpected error"' in said
    assert '"event": "database error"' in said
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert farm.errors in files
    assert len(files) >= 3
    for bearer in [*bearers, "trifarm_wr0ng_" + "n0b0dy" * 8]:
        secret = bearer.split("_", 2)[2].encode()
        for path in files:
            content = path.read_bytes()
            assert secret not in content, (path.name, content[max(0, content.find(secret) - 200) : content.find(secret)])
            assert secret[:20].upper() not in content, path.name


def test_a_setting_that_is_wrong_is_told_without_the_tokens(tmp_path):
    settings = {f"TRIFARM_{name.upper()}": value for name, value in GIVEN.items()}
    for wrong in ({"TRIFARM_PORT": "x"}, {"TRIFARM_TLS_KEY": "key.pem"}, {"TRIFARM_ADMIN_TOKEN": "4dm1n" * 8}):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")} | settings | wrong
        port = () if "TRIFARM_PORT" in wrong else ("--port", "0")
        said = tmp_path / "said.txt"
        said.write_text("")
        ended = Forked("services.__main__", ["serve", "--data", tmp_path / "farm", *port], cwd=ROOT, env=environment, errors=said)
        assert ended.wait(PATIENCE_S) != 0
        text = said.read_text()
        assert text and not any(secret in text for secret in ("4dm1n4dm1n", "r0b0tr0b0t")), text
