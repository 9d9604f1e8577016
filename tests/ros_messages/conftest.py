"""Messages with random values."""

import pytest
from random_messages import random_message


@pytest.fixture(scope="session")
def filled():
    """The function that fills messages: a class and a random generator -> a message."""
    return random_message
