"""Who may talk to the server: names, origins and tokens, asked over real sockets."""

import asyncio
import socket
from concurrent.futures import ThreadPoolExecutor

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.viewer.server import Access, ViewerServer

TOKEN = "0123456789abcdef"


def in_a_loop_of_its_own(question):
    """Run a coroutine in another thread: the session's browser may keep a loop running in this one."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, question).result()


def answer(url, **headers):
    """Status and text of a plain request."""

    async def ask():
        got = await AsyncHTTPClient().fetch(HTTPRequest(url, headers=headers), raise_error=False)
        return got.code, got.body.decode(), got.headers

    return in_a_loop_of_its_own(ask())


def first_word(url, **headers):
    """Status of a socket's opening, or the first text it sends."""

    async def ask():
        try:
            connection = await websocket_connect(HTTPRequest(url.replace("http", "ws", 1), headers=headers))
        except Exception as error:
            return getattr(error, "code", repr(error))
        text = await connection.read_message()
        connection.close()
        return text

    return in_a_loop_of_its_own(ask())


@pytest.fixture(scope="module")
def server(pepper):
    server = ViewerServer(pepper, port=0)
    yield server
    server.close()


@pytest.fixture(scope="module")
def guarded(pepper):
    server = ViewerServer(pepper, Access.of("127.0.0.1", False, TOKEN), port=0)
    yield server
    server.close()


def test_its_own_page_is_served_with_a_policy_that_names_no_other_place(server):
    code, text, headers = answer(server.url)
    assert code == 200
    assert "<title>Pepper</title>" in text
    policy = headers["Content-Security-Policy"]
    nonce = policy.split("'nonce-")[1].split("'")[0]
    assert text.count(f'<script nonce="{nonce}">') == text.count("<script") == 2
    assert "default-src 'none'" in policy
    assert headers["Cache-Control"] == "no-store"
    assert answer(server.url)[2]["Content-Security-Policy"] != policy
    assert '"type":"hello"' in first_word(server.url + "socket", Origin=server.url.rstrip("/"))


@pytest.mark.parametrize("path", ["", "socket", "nothing"])
@pytest.mark.parametrize(
    ("headers", "reason"),
    [
        ({"Origin": "http://evil.example"}, "Pages of other sites"),
        ({"Origin": "null"}, "Pages of other sites"),
        ({"Origin": "http://127.0.0.1:1"}, "Pages of other sites"),
        ({"Host": "evil.example"}, "does not go by that name"),
        ({"Host": "evil.example:80", "Origin": "http://evil.example:80"}, "does not go by that name"),
        ({"Host": "127.0.0.1.evil.example"}, "does not go by that name"),
    ],
)
def test_foreign_origins_and_names_are_refused(server, path, headers, reason):
    code, text, _ = answer(server.url + path, **headers)
    assert code == 403
    assert reason in text


def test_a_socket_from_a_foreign_origin_is_not_opened(server):
    assert first_word(server.url + "socket", Origin="http://evil.example") == 403
    assert first_word(server.url + "socket", Host="evil.example") == 403


def test_without_the_token_nothing_is_answered(guarded):
    bare = f"http://127.0.0.1:{guarded.port}/"
    for path in ("", "socket", "?token=wrong", "socket?token=", "nothing"):
        code, text, _ = answer(bare + path)
        assert code == 403
        assert "lacks the token" in text
    assert first_word(bare + "socket") == first_word(bare + "socket?token=" + TOKEN[:-1] + "x") == 403
    assert guarded.url == f"{bare}?token={TOKEN}"
    assert answer(guarded.url)[0] == 200
    assert '"type":"hello"' in first_word(f"{bare}socket?token={TOKEN}")
    assert answer(f"{bare}nothing?token={TOKEN}")[0] == 404


def test_beyond_loopback_an_option_is_asked_for_and_a_token_is_drawn():
    with pytest.raises(
        InvalidValueError, match=r"host: got '0\.0\.0\.0', expected a loopback address, or allow_remote"
    ):
        Access.of("0.0.0.0", allow_remote=False)
    first, second = Access.of("0.0.0.0", True), Access.of("0.0.0.0", True)
    assert len(first.token) == 32
    assert first.token != second.token
    assert Access.of("127.0.0.1", True).token is None
    assert Access.of("::1", False).token is None
    with pytest.raises(InvalidValueError, match="token: got something else, expected eight or more"):
        Access.of("127.0.0.1", False, "short")


def test_a_remote_server_goes_by_its_addresses_and_its_own_name_alone():
    access = Access.of("0.0.0.0", True, TOKEN)
    for host in ("192.168.1.7:7878", "localhost:7878", f"{socket.gethostname()}:7878", "[::1]:7878"):
        assert access.fault(host, f"http://{host}", TOKEN) is None
    for host in ("evil.example", "", None, "192.168.1.7.evil.example", "[::1"):
        assert "name" in access.fault(host, None, TOKEN)
    assert "token" in access.fault("192.168.1.7", None, None)
    assert "token" in access.fault("192.168.1.7", None, "ß")


def test_a_port_that_is_taken_is_named(server, pepper):
    with pytest.raises(InfeasibleError, match=f"no live page: .*port {server.port} cannot be had: .*in use"):
        ViewerServer(pepper, port=server.port)
    with pytest.raises(InvalidValueError, match="port: got 70000"):
        ViewerServer(pepper, port=70000)
    with pytest.raises(InfeasibleError, match=r"192\.0\.2\.1 port"):
        ViewerServer(pepper, Access.of("192.0.2.1", True), port=0)


def test_after_the_end_the_server_says_so(pepper):
    server = ViewerServer(pepper, port=0)
    server.close()
    server.close()
    with pytest.raises(InfeasibleError, match="its server has ended"):
        server.call(lambda session: session.q)


def test_the_command_refuses_a_remote_host_without_the_option(monkeypatch, capsys):
    from pepper_kin.cli import main

    monkeypatch.setattr("sys.argv", ["pepper-kin", "view", "--no-open", "--host", "0.0.0.0"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith(
        "pepper-kin: host: got '0.0.0.0', expected a loopback address, or allow_remote (--allow-remote)"
    )
    assert error.count("\n") == 1
