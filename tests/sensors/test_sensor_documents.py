"""The page about sensors names all of them; the example passes its own check."""

from pathlib import Path

from pepper_kin.twin.sensors import sensor_specifications

ROOT = Path(__file__).parents[2]


def test_the_page_names_every_sensor_with_its_rate():
    text = (ROOT / "docs" / "sensors.md").read_text(encoding="utf-8")
    for name, specification in sensor_specifications().items():
        short = "_" + name.rsplit("_", 1)[1]
        row = next(
            (line for line in text.splitlines() if line.startswith("| `") and f"`{name}`" in line), None
        )
        row = row or next(
            (line for line in text.splitlines() if "`head_touch_front`" in line and f"`{short}`" in line),
            None,
        )
        assert row is not None, f"add a row for {name!r} to the table in docs/sensors.md"
        assert f"| {specification.rate:g} Hz |" in row


def test_the_example_passes_its_own_check(run_example, tmp_path):
    assert len((ROOT / "examples" / "14_sensors.py").read_text().splitlines()) < 100
    assert run_example("14_sensors.py", cwd=tmp_path).returncode == 0
