"""Servers under a client with thousands of connections and no token: is one with the token served, and when?

Each server runs with 1,024 files.  An attacker in a process of its own keeps up to 10,000 connections open,
each with a part of a first message, and opens a new one for each that the server closes.  Meanwhile a client
with the token connects anew, five times a second.  All of it is on loopback, so both have one address.

    python benchmarks/half_open.py --connections 10000 --seconds 10
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

TOKEN = "0123456789abcdef"
FILES = 1024
PAUSE, LIMIT = 0.2, 5.0
"""Between two connections of the client, and the longest that it waits [s]."""
SERVERS = {
    "live page": ["view", "--no-open", "--port", "0", "--token", TOKEN],
    "rosbridge": ["ros", "--port", "0", "--cameras", "none", "--token", TOKEN],
    "NAOqi": ["naoqi", "serve", "--port", "0", "--token", TOKEN],
}
HTTP = {
    "silent": b"",
    "half": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-a: b\r\n",
    "no token": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
}
QI_HELLO = b"\x42\xde\xad\x42" + (1).to_bytes(4, "little") + (4).to_bytes(4, "little")
QI_HELLO += bytes.fromhex("0000010000000000 0000000008000000") + bytes(4)
"""Ask libqi to authenticate, with no capabilities."""
QI = {"silent": b"", "half": QI_HELLO[:20], "no token": QI_HELLO}


def attack(port: int, first: bytes, most: int, seconds: float) -> dict[str, int]:
    """Keep connections open; return how many were opened, and how many were open at once."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (most + 100, max(most + 100, _hard_limit())))
    poll, held = select.epoll(), {}
    opened = peak = 0
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        for _ in range(min(200, most - len(held))):
            link = socket.socket()
            link.settimeout(1.0)
            try:
                link.connect(("127.0.0.1", port))
                link.send(first)
            except OSError:
                link.close()
                continue
            held[link.fileno()] = link
            poll.register(link, select.EPOLLIN | select.EPOLLRDHUP)
            opened += 1
        peak = max(peak, len(held))
        for number, event in poll.poll(0.0 if len(held) < most else 0.05, 1000):
            if event & (select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR):
                held.pop(number).close()
            else:
                held[number].recv(65_536)
    return {"opened": opened, "peak": peak}


def ask_http(port: int) -> None:
    """Get an answer to a request with the token."""
    with socket.create_connection(("127.0.0.1", port), LIMIT) as link:
        link.sendall(
            f"GET /socket?token={TOKEN} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert link.recv(100).startswith(b"HTTP/1.1 101")


def ask_naoqi(port: int) -> None:
    """Read a joint with a session that states the token."""
    import qi

    session = qi.Session()
    session.connect(f"tcp://127.0.0.1:{port}", _async=True).value(int(1000 * LIMIT))
    opened = session.service("Access").unlock(TOKEN)
    assert len(opened.service("ALMotion").getAngles("HeadYaw", True)) == 1
    session.close(_async=True).wait(1000)


@contextmanager
def served(name: str, log: Path) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """Run a server with 1,024 files; yield its port and process."""
    command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", *SERVERS[name]]
    with log.open("w") as errors:
        server = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES)),
        )
    try:
        assert server.stdout is not None
        line = next(line for line in server.stdout if "://" in line)
        yield int(re.search(r"://[^:/]+:([0-9]+)", line).group(1)), server
    finally:
        server.terminate()
        server.wait(30)


def measured(name: str, kind: str, count: int, seconds: float) -> dict[str, object]:
    """Attack a server while a client with the token asks it; return the figures."""
    first = (QI if name == "NAOqi" else HTTP)[kind]
    ask: Callable[[int], None] = ask_naoqi if name == "NAOqi" else ask_http
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with served(name, log) as (port, _):
            ask(port)
            start = log.stat().st_size
            command = [sys.executable, __file__, "--attack", str(port), first.hex(), str(count), str(seconds)]
            attacker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            begun, times, failed = time.monotonic(), [], 0
            while attacker.poll() is None:
                asked = time.monotonic()
                try:
                    ask(port)
                    times.append(time.monotonic() - asked)
                except (OSError, RuntimeError, AssertionError):
                    failed += 1
                time.sleep(PAUSE)
            grown = (log.stat().st_size - start) / (time.monotonic() - begun)
            assert attacker.stdout is not None
            done = json.loads(attacker.stdout.read())
    times.sort()
    return {
        "server": name,
        "kind": kind,
        **done,
        "asked": len(times) + failed,
        "failed": failed,
        "median": times[len(times) // 2] if times else None,
        "longest": times[-1] if times else None,
        "log": grown,
    }


def _hard_limit() -> int:
    return resource.getrlimit(resource.RLIMIT_NOFILE)[1]


def main() -> None:
    """Print the table, or attack in the process of an attacker."""
    if sys.argv[1:2] == ["--attack"]:
        port, first, count, seconds = sys.argv[2:]
        print(json.dumps(attack(int(port), bytes.fromhex(first), int(count), float(seconds))))
        os._exit(0)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connections", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--servers", nargs="*", choices=list(SERVERS), default=list(SERVERS))
    parser.add_argument("--kinds", nargs="*", choices=list(HTTP), default=list(HTTP))
    arguments = parser.parse_args()
    print("| server | sent | opened | held | asked | failed | median [ms] | longest [ms] | log [B/s] |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in arguments.servers:
        for kind in arguments.kinds:
            row = measured(name, kind, arguments.connections, arguments.seconds)
            median, longest = (
                "-" if row[k] is None else f"{1000 * float(str(row[k])):.0f}" for k in ("median", "longest")
            )
            print(
                f"| {name} | {kind} | {row['opened']} | {row['peak']} | {row['asked']} | {row['failed']} "
                f"| {median} | {longest} | {row['log']:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
