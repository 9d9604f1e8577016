"""Numbers typed on the live page: messages of the server that arrive late do not replace them."""

import re

import numpy as np
import pytest

from pepper_kin.viewer.server import ViewerServer

pytestmark = pytest.mark.browser

HOLD_BACK = """() => {
    const receive = Link.prototype.receive;
    window.late = [];
    Link.prototype.receive = function (data) {
        const state = typeof data === 'string' && JSON.parse(data).type === 'state';
        if (state && 'targets' in JSON.parse(data).values) late.push(() => receive.call(this, data));
        else receive.call(this, data);
    };
    window.deliver = (count) => late.splice(0, count).forEach((message) => message());
}"""
"""From now on, messages with targets arrive when the test calls `deliver`."""


@pytest.fixture
def server(pepper):
    server = ViewerServer(pepper, port=0)
    server.call(lambda session: session.set_follow(False))
    yield server
    server.close()


def move(server, position):
    server.call(lambda session: session.move_target("left hand", np.array(position)))


def target(server):
    return server.call(lambda session: session.targets["left hand"].position)


def field(axis):
    return f"#left-hand-{axis}"


def delivered(condition):
    """A condition on the page once all messages have arrived."""
    return f"(deliver(99), {condition})"


def shows(axis, value):
    return f"document.getElementById('left-hand-{axis}').valueAsNumber === {value}"


@pytest.mark.thorough
def test_every_number_has_three_digits(open_live, until, server):
    page = open_live(server.url, scale=0.5)
    move(server, (0.24, 0.2, 0.8))
    until(page, shows("x", 0.24))
    page.click("button[name=add-box]")
    until(page, "document.querySelector(\"[data-name='box 1']\") !== null")
    texts = page.evaluate("[...document.querySelectorAll('#panel input[type=number]')].map((i) => i.value)")
    assert len(texts) == 9 + 6
    assert all(re.fullmatch(r"-?\d\.\d{3}", text) for text in texts), texts


@pytest.mark.thorough
def test_a_late_message_does_not_replace_a_number_that_is_typed(open_live, until, server):
    page = open_live(server.url, scale=0.5)
    move(server, (0.3, 0.2, 0.8))
    until(page, shows("x", 0.3))
    page.evaluate(HOLD_BACK)

    # On its way while the field is chosen and typed into: the selection stays, and what is typed replaces it.
    move(server, (0.31, 0.21, 0.81))
    until(page, "late.length === 1")
    page.locator(field("x")).select_text()
    page.evaluate("deliver(1)")
    page.keyboard.type("0.38")
    assert page.input_value(field("x")) == "0.38"

    # On its way while the number is sent: it holds the one before, which must not be sent with the next.
    move(server, (0.32, 0.22, 0.82))
    until(page, "late.length === 1")
    page.keyboard.press("Tab")
    page.evaluate("deliver(1)")
    assert page.input_value(field("x")) == "0.38"
    page.keyboard.type("0.25")
    page.keyboard.press("Enter")
    until(page, delivered("pepperKin.values.targets['left hand'].position[1] === 0.25"))
    np.testing.assert_allclose(target(server)[:2], [0.38, 0.25], atol=1e-12)
    until(page, shows("x", 0.38))

    # Once nobody types, the page shows what the server has.
    page.evaluate("document.activeElement.blur()")
    move(server, (0.4, 0.3, 0.9))
    for axis, value in (("x", 0.4), ("y", 0.3), ("z", 0.9)):
        until(page, delivered(shows(axis, value)))


@pytest.mark.thorough
def test_steps_of_the_arrow_keys_add_up_while_messages_are_late(open_live, until, server):
    page = open_live(server.url, scale=0.5)
    move(server, (0.3, 0.2, 0.8))
    until(page, shows("z", 0.8))
    page.evaluate(HOLD_BACK)
    page.focus(field("z"))
    for _ in range(5):
        page.keyboard.press("ArrowUp")
        until(page, "late.length >= 1")
        # Of two messages the one before the last step arrives now, and the last one at the next step.
        page.evaluate("deliver(late.length - 1)")
    until(page, delivered("Math.abs(pepperKin.values.targets['left hand'].position[2] - 0.85) < 1e-6"))
    np.testing.assert_allclose(target(server), [0.3, 0.2, 0.85], atol=1e-9)


@pytest.mark.thorough
def test_a_number_that_the_server_refuses_comes_back_as_it_was(open_live, until, server):
    page = open_live(server.url, scale=0.5)
    page.click("button[name=add-box]")
    until(page, "document.querySelector(\"[data-name='box 1']\") !== null")
    size = page.get_by_label("size of box 1: z [m]")
    before = size.input_value()
    size.fill("-1")
    size.press("Tab")
    until(page, "document.getElementById('message').textContent.startsWith(\"size of 'box 1': got\")")
    until(page, f"document.querySelector(\"[aria-label='size of box 1: z [m]']\").value === '{before}'")
