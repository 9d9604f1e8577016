"""The module `qi` of scripts: futures, signals, properties, strands and services as libqi has them."""

import threading
import time
from functools import partial

import pytest

from pepper_kin.naoqi import Broker
from pepper_kin.naoqi.shims import qi, set_broker


@pytest.fixture(autouse=True, params=[True, False], ids=["wall", "simulated"])
def twin(request):
    with Broker(real_time=request.param) as broker:
        set_broker(broker)
        yield broker
        set_broker(None)


def test_a_promise_is_kept_once():
    promise = qi.Promise()
    future = promise.future()
    assert (future.isRunning(), future.wait(0)) == (True, qi.FutureState.Running)
    with pytest.raises(RuntimeError, match="timeout"):
        future.value(10)
    promise.setValue(3)
    assert (future.value(), future.wait(), future.error()) == (3, qi.FutureState.FinishedWithValue, "")
    for late in (lambda: promise.setValue(4), lambda: promise.setError("no"), promise.setCanceled):
        with pytest.raises(RuntimeError, match="already"):
            late()


def test_what_follows_a_future_has_its_value_its_error_or_its_end():
    def double(value):
        return 2 * value

    for settle, value, error, canceled in [
        (lambda p: p.setValue(4), 8, "", False),
        (lambda p: p.setError("broken"), None, "broken", False),
        (lambda p: p.setCanceled(), None, "", True),
    ]:
        promise, calls = qi.Promise(), []
        after = promise.future().andThen(double)
        promise.future().addCallback(calls.append)
        promise.future().addCallback(lambda: None)  # takes no argument: what it raises is lost
        settle(promise)
        assert (after.isCanceled(), after.error()) == (canceled, error)
        assert calls == [promise.future()]
        if value is not None:
            assert after.value() == value
    assert qi.Future(1).then(lambda f: 1 / 0).error() == "ZeroDivisionError: division by zero"
    assert qi.Future(qi.Future(5)).unwrap().value() == 5
    assert qi.Future(5).unwrap().hasError()


def test_to_cancel_asks_whoever_promised():
    asked = []
    promise = qi.Promise(lambda p: asked.append(p.isCancelRequested()) or p.setValue("enough"))
    future = promise.future().then(lambda f: f.value())
    future.cancel()
    assert (asked, future.value()) == ([True], "enough")
    several = [qi.Promise() for _ in range(3)]
    barrier = qi.futureBarrier([p.future() for p in several])
    several[0].setValue(0)
    barrier.cancel()
    assert [p.isCancelRequested() for p in several] == [False, True, True]
    for p in several[1:]:
        p.setCanceled()
    assert [f.isCanceled() for f in barrier.value()] == [False, True, True]


@pytest.mark.thorough
def test_a_delayed_call_is_cancelled_before_it_begins(twin):
    called = []
    future = qi.runAsync(called.append, 1, delay=2_000_000)
    future.cancel()
    future.wait()
    twin.body.time.sleep(2.5)
    assert (future.isCanceled(), called) == (True, [])
    assert qi.runAsync(lambda a, b=1: a + b, 1, b=4, delay=1000).value() == 5
    assert qi.runAsync(int, "no").error().startswith("ValueError: invalid literal")


def test_to_cancel_does_not_wait_for_a_strand_that_waits_for_the_clock(twin):
    inside = threading.Event()

    @qi.singleThreaded()
    class Mover:
        def move(self):
            inside.set()
            twin.motion.angleInterpolation("HeadYaw", [0.1, 0.0], [0.5, 1.0], True)

        def after(self, _):
            return "after"

    mover, future = Mover(), qi.runAsync(int, delay=100_000_000)
    after, moved = future.then(mover.after), qi.runAsync(mover.move)
    assert inside.wait(60)
    threading.Thread(target=future.cancel, daemon=True).start()
    assert moved.wait(10_000) == qi.FutureState.FinishedWithValue
    assert (future.isCanceled(), after.value(10_000)) == (True, "after")


def test_calls_of_a_single_threaded_object_do_not_overlap():
    @qi.singleThreaded()
    class Counter:
        def __init__(self):
            self.busy, self.count, self.overlaps = False, 0, 0

        def step(self, *_):
            self.overlaps += self.busy
            self.busy = True
            time.sleep(0.002)
            self.busy = False
            self.count += 1

    counter, signal, value, promise = Counter(), qi.Signal("m"), qi.Property("i"), qi.Promise()
    for _ in range(5):
        signal.connect(counter.step)
        value.connect(partial(counter.step, 1))
        promise.future().addCallback(partial(Counter.step, counter))
    futures = [qi.runAsync(counter.step) for _ in range(5)]
    emitters = [
        threading.Thread(target=f) for f in (signal, partial(value.setValue, 3), partial(promise.setValue, 1))
    ]
    for thread in emitters:
        thread.start()
    for thread in emitters:
        thread.join()
    qi.futureBarrier(futures).value()
    assert (counter.count, counter.overlaps) == (20, 0)


@pytest.mark.parametrize(
    ("signature", "first", "good", "bad"),
    [("i", 0, -4, "four"), ("s", "", "a", 1), ("[f]", [], [1.0], 2.0), ("{si}", {}, {"a": 1}, None),
     ("+s", None, None, 3), ("m", None, object, ...)],
)  # fmt: skip
def test_a_property_has_a_type_and_tells_its_value(signature, first, good, bad):
    prop, told = qi.Property(signature), []
    assert prop.value() == first
    link = prop.addCallback(told.append)
    prop.setValue(good)
    if bad is not ...:
        with pytest.raises(RuntimeError, match="cannot convert"):
            prop.setValue(bad)
    assert prop.disconnect(link)
    prop.setValue(good)
    assert (prop.value(), told) == (good, [good])


def test_a_signal_says_whether_somebody_listens():
    said = []
    signal = qi.Signal("m", said.append)
    links = [signal.connect(print), signal.connect(print)]
    assert [signal.disconnect(link) for link in (*links, links[0])] == [True, True, False]
    signal.connect(print)
    assert signal.disconnectAll()
    assert said == [True, False, True, False]


def test_services_of_scripts_are_called_as_they_are_bound():
    class Service:
        def __init__(self):
            self.level = qi.Property("i")

        @qi.bind(qi.Dynamic, (), "renamed")
        def own(self):
            return 1

        @qi.nobind
        def hidden(self):
            return 2

        @staticmethod
        def triple(x):
            return 3 * x

        def promised(self):
            return qi.runAsync(lambda: 4)

        def same(self, value):
            return value

    session, other, gone = qi.Session(), qi.Session(), []
    session.listenStandalone("tcp://127.0.0.1:0")
    other.connect(session.endpoints()[0])
    other.disconnected.connect(gone.append)
    waiting = other.waitForService("Own", _async=True)
    number = session.registerService("Own", Service())
    waiting.value()
    own = other.service("Own")
    assert (own.renamed(), own.triple(2), own.promised(), own.promised(_async=True).value()) == (1, 6, 4, 4)
    assert own.same({1, 2}) == (1, 2)
    own.level.setValue(5)
    assert other.service("Own").level.value() == 5
    assert not hasattr(own, "hidden")
    session.unregisterService(number)
    with pytest.raises(RuntimeError, match="Cannot find service 'Own'"):
        other.service("Own")
    other.close()
    assert (other.isConnected(), gone) == (False, ["closed"])


def test_services_without_self_or_with_wrong_types_are_refused():
    class NoSelf:
        def method():
            pass

    class WrongType:
        @qi.bind(qi.Float, [42])
        def method(self, a):
            pass

    for service, words in ((NoSelf(), "has no self"), (WrongType(), "types that are none of qi's")):
        with pytest.raises(RuntimeError, match=words):
            qi.Session().registerService("Wrong", service)


def test_messages_are_kept_up_to_their_level(twin, monkeypatch):
    monkeypatch.setattr(qi.logging, "_LEVELS", {"*": qi.logging.INFO})
    logger = qi.logging.Logger("script.part")
    qi.logging.setLevel(qi.logging.ERROR)
    logger.warning("not this")
    logger.error("this", 1)
    qi.logging.setFilters("+script*=5")
    logger.verbose("this too")
    qi.logging.setFilters("-script*")
    logger.fatal("not that")
    assert [text for _, text in twin.logged] == ["script.part: this 1", "script.part: this too"]
