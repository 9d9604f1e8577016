"""A word to those who wait for machine code."""

import logging
import time

from pepper_kin.kernels.compilation import Compilation


def messages(caplog):
    return [record.getMessage() for record in caplog.records]


def test_it_speaks_while_it_lasts_and_at_the_end(caplog):
    with caplog.at_level(logging.WARNING, logger="pepper_kin"):
        compilation = Compilation("the loop", patience=0.01)
        deadline = time.perf_counter() + 30
        while not caplog.records and time.perf_counter() < deadline:
            time.sleep(0.01)
        assert messages(caplog) == ["compiling the loop, once on this machine; it may take a minute ..."]
        compilation.end(compiled=True)
    assert messages(caplog)[1].startswith("compiled the loop, once on this machine, in ")
    assert messages(caplog)[1].endswith(" s; from now on it is loaded from disk")


def test_what_is_loaded_from_disk_is_not_worth_a_word(caplog):
    with caplog.at_level(logging.WARNING, logger="pepper_kin"):
        compilation = Compilation("the loop", patience=0.2)
        compilation.end(compiled=False)
        time.sleep(0.4)
    assert not messages(caplog)
