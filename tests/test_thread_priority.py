"""What Linux says of threads that asked for short time slices, or made way."""

import ctypes
import os
import platform
import struct
import sys
import threading

import pytest

from pepper_kin.naoqi.thread_priority import PATIENCE, SLICE, wake_promptly, yield_to_others

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads have no nice value of their own")
GET_ATTRIBUTES = {"x86_64": 315, "aarch64": 275}


def in_a_thread(function):
    """Return what a function returns in a thread of its own."""
    found = []
    thread = threading.Thread(target=lambda: found.append(function()))
    thread.start()
    thread.join()
    return found[0]


def attributes():
    """Return policy, nice value and time slice [ns] of this thread."""
    kept = ctypes.create_string_buffer(48)
    if ctypes.CDLL(None).syscall(GET_ATTRIBUTES[platform.machine()], 0, kept, 48, 0) != 0:
        pytest.skip("the system does not say what slices a thread has")
    _, policy, _, nice, _, runtime, _, _ = struct.unpack("=IIQiIQQQ", kept.raw)
    return policy, nice, runtime


@pytest.mark.skipif(platform.machine() not in GET_ATTRIBUTES, reason="the number of the call is not known")
def test_a_thread_gets_short_slices_and_keeps_the_rest():
    def ask():
        before = attributes()
        return before, wake_promptly(), attributes()

    others = attributes()  # skips, where it does
    before, granted, after = in_a_thread(ask)
    assert granted
    assert after[:2] == before[:2]
    assert after[2] in (SLICE, before[2])  # before Linux 6.12 slices are nobody's to choose
    assert attributes() == others


def test_a_thread_of_a_real_time_policy_is_left_alone(monkeypatch):
    monkeypatch.setattr(os, "sched_getscheduler", lambda thread: os.SCHED_FIFO)
    assert in_a_thread(wake_promptly) is False


def test_only_the_thread_that_makes_way_is_nicer():
    def make_way():
        before = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
        yield_to_others()
        return before, os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    here = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    before, after = in_a_thread(make_way)
    assert after == min(before + PATIENCE, 19)
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == here
