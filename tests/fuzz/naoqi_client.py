"""A client of qi that calls methods of all services with wrong arguments: `naoqi_client.py URL COUNT SEED`.

Prints how many were refused.
"""

import random
import sys

import qi

WORDS = ("HeadYaw", "Body", "LArm", "Arms", "Tail", "", "x" * 2000, "é", "Device/SubDeviceList", "Stand")
NUMBERS = (0, 1, -1, 2**31, -(10**18), 0.5, -3.0, 1e308, 5e-324, float("nan"), float("inf"))
WAIT = 50  # ms
KEPT = 40  # calls that may be under way


def value(rng, depth=0):
    """Return something that a method may not expect."""
    kind = rng.randrange(7 if depth < 3 else 4)
    if kind == 0:
        return rng.choice(WORDS)
    if kind == 1:
        return rng.choice(NUMBERS)
    if kind == 2:
        return rng.choice((None, True, False))
    if kind == 3:
        return rng.uniform(-2.0, 2.0)
    if kind == 4:
        return {rng.choice(WORDS): value(rng, depth + 1) for _ in range(rng.randrange(3))}
    return [value(rng, depth + 1) for _ in range(rng.randrange(4))]


def of_type(rng, signature):
    """Return a value of a type, as libqi writes it, and what is left of the signature."""
    kind, rest = signature[0], signature[1:]
    if kind in "[({":
        parts = []
        for _ in range(rng.randrange(4) if kind == "[" else 1):
            part = of_type(rng, rest)[0]
            parts.append(part)
        if kind == "[":
            return parts, skipped(signature)
        return ({} if kind == "{" else tuple(parts)), skipped(signature)
    if kind == "s":
        return rng.choice(WORDS), rest
    if kind == "b":
        return rng.random() < 0.5, rest
    if kind in "iI":
        return rng.choice((0, 1, 7, 2**31 - 1)), rest
    if kind == "f":
        return rng.choice((*NUMBERS[5:], rng.uniform(-2.0, 2.0))), rest
    return value(rng), rest


def skipped(signature):
    """Return what is behind the first type of a signature."""
    depth = 0
    for place, letter in enumerate(signature):
        depth += (letter in "[({") - (letter in "])}")
        if depth == 0:
            return signature[place + 1 :]
    return ""


def arguments_of(rng, signature):
    """Return arguments for a method, most of them of its types."""
    inside, found = signature[1:-1], []
    while inside:
        made, inside = of_type(rng, inside)
        found.append(made if rng.random() < 0.9 else value(rng))
    if rng.random() < 0.05:
        found.append(value(rng))
    return found


def methods(session):
    """Return service -> names and signatures of the arguments of its methods."""
    found = {}
    for name in sorted(one["name"] for one in session.services()):
        if name not in ("ServiceDirectory", "LogManager"):
            listed = session.service(name).metaObject()["methods"].values()
            found[name] = sorted(
                (one["name"], one["parametersSignature"]) for one in listed if one["uid"] >= 100
            )
    return found


def main(url, count, seed):
    """Make the calls."""
    rng = random.Random(seed)
    session = qi.Session()
    session.connect(url)
    services = methods(session)
    names = [name for name in services if services[name]]
    refused, under_way = 0, []
    for number in range(count):
        service = rng.choice(names) if rng.random() < 0.6 else "ALMotion"
        method, signature = rng.choice(services[service])
        arguments = arguments_of(rng, signature)
        try:
            under_way.append(getattr(session.service(service), method)(*arguments, _async=True))
        except RuntimeError:
            refused += 1
        if len(under_way) > KEPT or number == count - 1:
            session.service("ALMotion").killAll()
            session.service("ALMotion").stopMove()
            for future in under_way:
                future.wait(WAIT)
            refused += sum(future.isFinished() and future.hasError(0) for future in under_way)
            under_way = [future for future in under_way if not future.isFinished()][-KEPT // 2 :]
    print(refused)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
