"""Programs in the environment with ROS 2, ordered by JSON lines."""

import base64
import json
import os
import subprocess
from pathlib import Path

import ros_environment

from pepper_kin.ros_messages import decode, encode

FOLDER = Path(__file__).parent


def environment_variables(**variables):
    """Return the variables of a program with ROS 2, on this machine and in the domain of this process."""
    common = {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONPATH": str(ros_environment.ROOT),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",  # memory shared with what was killed swallows messages
    }
    return ros_environment.clean_environment() | common | variables


class Peer:
    """A program; `peer.publish(topic=..., data=message)` has it call its function of this name."""

    def __init__(self, python, script, *arguments, **variables):
        self.process = subprocess.Popen(
            [str(python), str(FOLDER / script), *arguments],
            env=environment_variables(**variables),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert json.loads(self.process.stdout.readline() or "{}").get("ready"), f"{script} did not start"

    def __getattr__(self, name):
        def call(**values):
            if "data" in values:
                values["data"] = base64.b64encode(encode(values["data"])).decode()
            self.process.stdin.write(json.dumps({"do": name, **values}) + "\n")
            self.process.stdin.flush()
            answer = json.loads(self.process.stdout.readline() or '{"error": "it has ended"}')
            assert "error" not in answer, f"{name}({values}): {answer['error']}"
            return answer["value"]

        return call

    def messages(self, kind, **values):
        """Return what it has heard, as messages."""
        return [decode(kind, base64.b64decode(text)) for text in self.heard(**values)]

    def next_message(self, kind, topic):
        """Return the next message that it hears."""
        return decode(kind, base64.b64decode(self.newest(topic=topic)[0]))

    def end(self):
        self.process.stdin.close()
        try:
            self.process.wait(20)
        finally:
            self.process.kill()
            self.process.wait()
