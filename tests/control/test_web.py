import asyncio
import json
import re
import threading

import pytest
from aiohttp import ClientSession, WSMsgType, web

from sumo_dist.control import rerun_proxy
from sumo_dist.control.answer import Answer
from sumo_dist.control.picture import Picture
from sumo_dist.control.web import PAGE, Access, ControlServer
from sumo_dist.wire.keys import SCHEMA, Member, unique_name, view_token

REFUSED = "goal must be from -8 to 8 m"


class Given:
    """Takes commands; the ones named "wait" last until they are released."""

    def __init__(self):
        self.commands, self.release = [], threading.Event()

    def __call__(self, verb, name, value):
        self.commands.append((verb, name, value))
        if name == "wait":
            assert self.release.wait(20)
        return Answer(REFUSED) if name == "goal" else Answer(tick=12)


class Served:
    """A server on loopback and a browser's side of it, without a browser."""

    def __init__(self, session, base, given, picture):
        self.session, self.base, self.given, self.picture = session, base, given, picture

    def get(self, path, **headers):
        return self.session.get(self.base + path, headers=headers)

    def live(self, **headers):
        return self.session.ws_connect(self.base + "/live", headers=headers)


def serve(check, access=None, steers=True):
    """Run a check, a coroutine function, against a server."""

    async def run():
        given, picture = Given(), Picture("spot")
        server = ControlServer(picture, given if steers else None, access or Access())
        runner = web.AppRunner(server.app(), shutdown_timeout=0.5)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        port = runner.addresses[0][1]
        async with ClientSession() as session:
            await check(Served(session, f"http://127.0.0.1:{port}", given, picture))
        given.release.set()
        await runner.cleanup()

    asyncio.run(asyncio.wait_for(run(), 60))


async def heard(socket, key):
    """Return the next message of a kind."""
    async for message in socket:
        assert message.type is WSMsgType.TEXT
        if key in (told := json.loads(message.data)):
            return told[key]
    raise AssertionError("the line was closed")


def test_the_page_and_all_that_it_names_are_there():
    async def check(served):
        async with served.get("/") as response:
            text = await response.text()
            assert "frame-ancestors 'none'" in response.headers["Content-Security-Policy"]
        assert response.status == 200
        for path in PAGE.iterdir():
            async with served.get(f"/page/{path.name}") as response:
                assert response.status == 200
        assert 'src="page/main.js"' in text
        for path in ("/page/../web.py", "/page/none.js", "/etc/passwd"):
            async with served.get(path) as response:
                assert response.status == 404

    serve(check)


def test_the_page_asks_nobody_else():
    address = re.compile(r"""["'(`](?:https?:)?//""")
    assert address.search('import "//cdn.example/x.js"')
    assert not [path.name for path in PAGE.iterdir() if address.search(path.read_text("utf-8"))]


def test_pictures_come_and_commands_are_answered():
    async def check(served):
        async with served.live() as socket:
            assert await heard(socket, "steers") is True
            assert (await heard(socket, "picture"))["robot"]["name"] == "spot"
            await socket.send_json({"id": 7, "verb": "weight", "name": "gripper", "value": "3"})
            assert await heard(socket, "answer") == {"id": 7, "refusal": "", "tick": 12}
            await socket.send_json({"id": 8, "verb": "parameter", "name": "goal", "value": "9,9"})
            assert await heard(socket, "answer") == {"id": 8, "refusal": REFUSED, "tick": 0}
        assert served.given.commands == [("weight", "gripper", "3"), ("parameter", "goal", "9,9")]

    serve(check)


def test_what_is_no_command_of_ours_is_left_alone():
    async def check(served):
        async with served.live() as socket:
            for text in ("", "[]", "null", "7", "{", '"stop"'):
                await socket.send_str(text)
            await socket.send_json({"id": 1, "verb": "pause"})
            assert (await heard(socket, "answer"))["id"] == 1
        async with served.live() as socket:
            await socket.send_str("x" * 10_000)
            async for _ in socket:
                pass  # until it is closed
        assert served.given.commands == [("pause", "", "")]

    serve(check)


def test_a_stop_overtakes_a_command_that_waits_for_the_robot():
    async def check(served):
        async with served.live() as socket:
            await socket.send_json({"id": 1, "verb": "planner", "name": "wait"})
            await socket.send_json({"id": 2, "verb": "weight"})
            await socket.send_json({"id": 3, "verb": "stop"})
            assert (await heard(socket, "answer"))["id"] == 3
            served.given.release.set()
            assert [(await heard(socket, "answer"))["id"] for _ in range(2)] == [1, 2]
        assert [verb for verb, *_ in served.given.commands] == ["planner", "stop", "weight"]

    serve(check)


def test_every_client_gets_the_pictures_and_one_that_leaves_harms_nobody():
    async def check(served):
        async with served.live() as first:
            async with served.live() as second:
                await heard(second, "picture")
            for _ in range(3):
                await heard(first, "picture")

    serve(check)


def test_a_client_that_takes_nothing_keeps_no_other_waiting(monkeypatch):
    monkeypatch.setattr(Picture, "snapshot", lambda self: {"long": "x" * 4_000_000})

    async def check(served):
        host, port = served.base.removeprefix("http://").split(":")
        reader, writer = await asyncio.open_connection(host, int(port), limit=1024)
        key = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        key += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        writer.write(f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\n{key}\r\n".encode())
        assert b"101" in await reader.readline()
        async with served.session.ws_connect(served.base + "/live", max_msg_size=0) as other:
            for _ in range(5):
                await heard(other, "picture")
        writer.close()

    serve(check)


def test_a_page_that_only_shows_takes_no_commands():
    async def check(served):
        async with served.live() as socket:
            assert await heard(socket, "steers") is False
            await socket.send_json({"id": 1, "verb": "stop"})
            assert (await heard(socket, "answer"))["refusal"] == "this page only shows the run"

    serve(check, steers=False)


@pytest.mark.parametrize(
    ("headers", "reason"),
    [
        ({"Host": "evil.example"}, "not called evil.example"),
        ({"Host": "127.0.0.1.evil.example:80"}, "not called"),
        ({"Origin": "http://evil.example"}, "may not steer"),
        ({"Origin": "null"}, "may not steer"),
        ({"Origin": "http://localhost:1"}, "may not steer"),
    ],
)
def test_another_sites_page_reaches_nothing(headers, reason):
    async def check(served):
        for path in ("/", "/live", "/view/", "/page/main.js"):
            async with served.get(path, **headers) as response:
                assert response.status == 403
                assert reason in await response.text()

    serve(check)


def test_a_tunnel_with_another_port_is_this_machine():
    async def check(served):
        names = {"Host": "localhost:9999", "Origin": "http://localhost:9999"}
        async with served.get("/", **names) as response:
            assert response.status == 200

    serve(check)


def test_beyond_this_machine_the_token_has_to_be_shown_once():
    async def check(served):
        for query in ("/", "/live", "/?token=", "/?token=wrong", "/?token=secre\u0000t", "/view/"):
            async with served.get(query, Host="robot.lab:80") as response:
                assert response.status == 403
                assert "token" in await response.text()
        async with served.get("/?token=secret", Host="robot.lab:80") as response:
            cookie = response.headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        shown = cookie.split(";")[0]
        async with served.get("/page/main.js", Host="robot.lab:80", Cookie=shown) as response:
            assert response.status == 200
        async with served.live(Cookie=shown) as socket:
            await heard(socket, "picture")

    serve(check, Access("secret", ()))


def test_reruns_page_and_data_are_passed_on_as_they_come(monkeypatch):
    """Its data is an answer without an end; a tracer that is not there yet is waited for."""

    async def check(served):
        with monkeypatch.context() as patch:
            patch.setattr(rerun_proxy, "GAP_S", 0.1)
            async with served.get("/view/") as response:
                assert response.status == 503

        async def early():
            async with served.get("/view/early") as response:
                return await response.text()

        waiting = asyncio.create_task(early())
        release = asyncio.Event()

        async def data(request):
            asked = await request.read()
            response = web.StreamResponse(headers={"Content-Type": "application/grpc-web"})
            await response.prepare(request)
            await response.write(b"first " + asked)
            await release.wait()
            await response.write(b" second")
            return response

        async def page(request):
            return web.Response(text=request.path, headers={"X-Own": "1", "ETag": '"e"'})

        async def rerun(port=0):
            app = web.Application()
            app.router.add_post("/rerun.sdk_comms.v1alpha1.Proxy/Read", data)
            app.router.add_get("/{path:.*}", page)
            runner = web.AppRunner(app)
            await runner.setup()
            await web.TCPSite(runner, "127.0.0.1", port).start()
            return runner

        runner = await rerun()
        port = runner.addresses[0][1]
        token = view_token(port, port)
        tracer = Member("tracer", unique_name(), SCHEMA, token)
        await asyncio.sleep(0.2)
        assert not waiting.done()
        served.picture.member(tracer, True)
        assert await waiting == "/early"
        async with served.get("/view/re_viewer_bg.wasm") as response:
            assert await response.text() == "/re_viewer_bg.wasm"
            assert response.headers["ETag"] == '"e"'
            assert "X-Own" not in response.headers
        address = served.base + "/rerun.sdk_comms.v1alpha1.Proxy/Read"
        async with served.session.post(address, data=b"x") as response:
            assert await response.content.readany() == b"first x"
            release.set()
            assert await response.content.readany() == b" second"
        await runner.cleanup()
        monkeypatch.setattr(rerun_proxy, "GAP_S", 0.1)
        async with served.get("/view/") as response:
            assert response.status == 502
        monkeypatch.setattr(rerun_proxy, "GAP_S", 30.0)
        waiting = asyncio.create_task(early())  # before it listens again
        await asyncio.sleep(0.2)
        assert not waiting.done()
        runner = await rerun(port)
        assert await waiting == "/early"
        await runner.cleanup()

    serve(check)
