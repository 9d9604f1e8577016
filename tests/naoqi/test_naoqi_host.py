"""Real clients of libqi, in processes of their own."""

import contextlib
import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap

import pytest

from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.naoqi import Broker, Host
from pepper_kin.servers.connection_gate import MOST_WAITING

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("qi") is None, reason="the package qi has no wheel for this machine"
)

CLIENT = textwrap.dedent(
    """
    import json, sys, time
    import qi
    session = qi.Session()
    session.connect(sys.argv[1])
    motion, memory = session.service("ALMotion"), session.service("ALMemory")
    said = {}
    motion.angleInterpolation("HeadYaw", 0.4, 0.5, True)
    said["yaw"] = motion.getAngles("HeadYaw", True)[0]
    future = motion.moveTo(2.0, 0.0, 0.0, _async=True)
    time.sleep(0.5)
    said["active"] = motion.moveIsActive()
    motion.stopMove()
    said["arrived"] = future.value()
    got = []
    subscriber = memory.subscriber("Own")
    subscriber.signal.connect(got.append)
    memory.raiseEvent("Own", [1, "two"])
    end = time.monotonic() + 60.0
    while not got and time.monotonic() < end:
        time.sleep(0.02)
    said["event"] = got
    for name, call in (
        ("unknown", lambda: motion.getAngles("Tail", True)),
        ("types", lambda: motion.getAngles(1)),
        ("feet", lambda: motion.setFootSteps(["Tail"], [[0.1, 0.0, 0.0]], [1.0], True)),
        ("station", lambda: session.service("ALRecharge").goToStation()),
    ):
        try:
            call()
        except RuntimeError as error:
            said[name] = str(error)
    video = session.service("ALVideoDevice")
    picture = video.getImageRemote(video.subscribeCamera("x", 0, 1, 11, 10))
    said["picture"] = [picture[0], picture[1], len(picture[6]), type(picture[6]).__name__]
    said["services"] = len(session.services())
    print(json.dumps(said))
    """
)


@pytest.fixture(scope="module")
def host():
    with Broker() as broker, Host(broker, port=0) as made:
        yield made


def ask(host):
    command = [sys.executable, "-c", CLIENT, host.url]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.thorough
def test_clients_move_the_robot_and_are_answered(host):
    out, error = ask(host).communicate(timeout=120)
    assert out, error
    said = json.loads(out)
    assert said["yaw"] == pytest.approx(0.4, abs=2e-3)
    assert said["active"] is True
    assert said["arrived"] is False
    assert said["event"] == [[1, "two"]]
    assert said["unknown"].startswith("ALMotion::getAngles\n\t'Tail' is no joint")
    assert "Arguments types did not match" in said["types"]
    assert "expected LLeg or RLeg" in said["feet"]
    assert "ALRecharge::goToStation" in said["station"]
    assert said["picture"] == [320, 240, 230400, "bytearray"]
    assert said["services"] > 60


@pytest.mark.thorough
def test_two_clients_at_once(host):
    clients = [ask(host), ask(host)]
    for client in clients:
        out, error = client.communicate(timeout=180)
        assert client.returncode == 0, error
        assert json.loads(out)["services"] > 60


def test_only_this_machine_unless_remote_is_allowed(host):
    with pytest.raises(InvalidValueError, match="allow_remote"):
        Host(host.broker, "0.0.0.0", 0)


SERVER = textwrap.dedent(
    """
    from pepper_kin.naoqi import Broker, Host
    from pepper_kin.servers.end_signals import ended_by_signals
    with ended_by_signals() as ended, Broker() as broker, Host(broker, port=0) as host:
        print(host.url, flush=True)
        host.wait(ended)
    print("ended", flush=True)
    """
)

BUSY = textwrap.dedent(
    """
    import sys, qi
    session = qi.Session()
    session.connect(sys.argv[1])
    motion = session.service("ALMotion")
    motion.angleInterpolation("HeadYaw", 0.5, 60.0, True, _async=True)
    motion.getAngles("HeadYaw", True)
    print("busy", flush=True)
    sys.stdin.read()
    """
)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_server_cleanly_while_a_client_waits(number):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", SERVER], **pipes) as server:
        url = next(line.strip() for line in server.stdout if line.startswith("tcp:"))
        with subprocess.Popen([sys.executable, "-c", BUSY, url], **pipes) as client:
            try:
                assert "busy\n" in iter(client.stdout.readline, "")
                server.send_signal(number)
                out, error = server.communicate(timeout=60)
            finally:
                client.kill()
                server.kill()
    assert server.returncode == 0, error
    assert out.endswith("ended\n")
    assert "terminate called" not in error


FAILED_CALL = textwrap.dedent(
    """
    import sys
    import qi
    session = qi.Session()
    session.connect(sys.argv[1])
    module = session.service("ALRecharge")
    number = module.pCall("tail")
    for _ in range(3):
        try:
            module.wait(number, 0)
        except RuntimeError as error:
            print(str(error).splitlines()[0])
    """
)


@pytest.mark.thorough
def test_a_server_ends_at_once_though_a_posted_call_failed():
    """Its error stays with the call, and kept the service: the end of the server waited for ten seconds."""
    with Broker() as broker, Host(broker, port=0) as host:
        command = [sys.executable, "-c", FAILED_CALL, host.url]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.stdout.splitlines()[-3:] == ["ALRecharge::tail"] * 3, done.stderr
        wire = host._wire
        host.close()
        assert list(wire._services) == []


@pytest.mark.thorough
def test_a_program_that_imports_qi_first_sees_no_log_of_each_service():
    """Libqi reads its settings as it is loaded, too early here; errors are still logged."""
    program = textwrap.dedent(
        """
        import qi
        from pepper_kin.naoqi import Broker, Host
        with Broker() as broker, Host(broker, port=0) as host:
            session = qi.Session()
            session.connect(host.url)
            print(len(session.services()))
            qi.logging.Logger("own").error("seen")
        """
    )
    environment = {name: value for name, value in os.environ.items() if name != "QI_LOG_LEVEL"}
    command, pipes = [sys.executable, "-c", program], {"capture_output": True, "text": True}
    done = subprocess.run(command, **pipes, timeout=120, check=False, env=environment)
    assert int(done.stdout.splitlines()[0]) > 80, done.stderr
    assert "Registered Service" not in done.stdout + done.stderr
    assert "seen" in done.stdout + done.stderr


@pytest.mark.thorough
def test_a_token_is_needed_to_move_and_not_to_read(host):
    calls = textwrap.dedent(
        """
        import json, sys, qi
        session = qi.Session()
        session.connect(sys.argv[1])
        motion, access = session.service("ALMotion"), session.service("Access")
        said = {"read": len(motion.getAngles("Body", True))}
        for name, call in (
            ("locked", lambda: motion.setAngles("HeadYaw", 0.3, 0.5)),
            ("wrong", lambda: access.unlock("another")),
        ):
            try:
                call()
            except RuntimeError as error:
                said[name] = str(error)
        opened = access.unlock("token0123").service("ALMotion")
        opened.angleInterpolation("HeadYaw", 0.3, 0.5, True)
        said["yaw"] = motion.getAngles("HeadYaw", True)[0]
        print(json.dumps(said))
        """
    )
    with Host(host.broker, port=0, token="token0123") as locked:
        done = subprocess.run(
            [sys.executable, "-c", calls, locked.url],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.stdout, done.stderr
    said = json.loads(done.stdout)
    assert said["read"] == 20
    assert "needs the token" in said["locked"]
    assert "wrong token" in said["wrong"]
    assert said["yaw"] == pytest.approx(0.3, abs=2e-3)


def test_an_empty_token_is_refused(host):
    with pytest.raises(InvalidValueError, match="token"):
        Host(host.broker, port=0, token="")


@pytest.mark.thorough
def test_half_messages_keep_no_client_out_and_other_bytes_end_their_connection(host):
    place = ("127.0.0.1", int(host.url.rpartition(":")[2]))
    links = [socket.create_connection(place, 30.0) for _ in range(2 * MOST_WAITING)]
    for link in links:
        try:
            link.sendall(b"\x42\xde\xad\x42" + bytes(10))
        except ConnectionError:  # one of the oldest: it has been closed for the newest
            continue
    for wrong in (b"GET / HTTP/1.1\r\n", b"\x42\xde\xad\x42" + b"\xff" * 24):
        with socket.create_connection(place, 30.0) as link:
            link.sendall(wrong)
            with contextlib.suppress(ConnectionError):  # that, too, is its end
                assert link.recv(1) == b""
    assert ask(host).wait(120) == 0
    for link in links:
        link.close()


def test_a_port_that_there_is_not_is_refused(host):
    """libqi takes another one for it, without a word."""
    for port in [-1, 65536, True, 9559.0, "9559"]:
        with pytest.raises(
            InvalidValueError, match=r"port: got .*, expected a whole number in 0 \.\.\. 65535"
        ):
            Host(host.broker, port=port)


@pytest.mark.thorough
def test_an_address_or_a_port_that_cannot_be_had_is_refused_by_name(host):
    port = int(host.url.rpartition(":")[2])
    with pytest.raises(InfeasibleError, match=f"127.0.0.1 port {port} cannot be had: .*in use"):
        Host(host.broker, port=port)
    with pytest.raises(InfeasibleError, match=r"no-such-host\.invalid port 9559 cannot be had: "):
        Host(host.broker, "no-such-host.invalid", allow_remote=True)
    assert ask(host).wait(60) == 0  # the simulated robot is as it was


@pytest.mark.thorough
@pytest.mark.parametrize("listens", [False, True], ids=["nobody", "silent"])
def test_a_robot_that_does_not_answer_is_named_and_the_process_ends(listens):
    """Also where coal was loaded before libqi, which then keeps a process whose connection is refused."""
    program = textwrap.dedent(
        """
        import sys, time
        import coal
        from pepper_kin.naoqi import Robot, RobotConnectionError
        begun = time.monotonic()
        try:
            Robot(sys.argv[1])
        except RobotConnectionError as error:
            print(error, time.monotonic() - begun < 10.0)
        """
    )
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        if not listens:
            server.close()
        url = f"tcp://127.0.0.1:{port}"
        done = subprocess.run(
            [sys.executable, "-c", program, url], capture_output=True, text=True, timeout=90, check=False
        )
    reason = "no answer within 5 s" if listens else "Connection refused"
    assert (done.returncode, done.stdout) == (0, f"{url}: connect: {reason} True\n"), done.stderr
