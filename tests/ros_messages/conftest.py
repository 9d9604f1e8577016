"""Messages with random values."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from random_messages import random_message


@pytest.fixture(scope="session")
def filled():
    """The function that fills messages: a class and a random generator -> a message."""
    return random_message
