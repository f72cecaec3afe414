"""Metashape's cameras.xml: its sensors, its lenses of both ages, chunk, components, turns."""

import numpy as np
import pytest
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, cameras, to_working, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.errors import InputError

GIVEN = cameras()
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # of a chunk in the world
SHIFT, SCALE = np.array([10.0, -20, 30]), 4.0
NEW = {"f": 700, "cx": 11, "cy": -12}  # from the middle of 640 x 480
LENS = {"k1": 0.1, "k2": -0.02, "k3": 0.01, "k4": 0.003, "p1": 0.004, "p2": -0.003}
SKEWED = {"b1": 5, "b2": 2}
CHUNK = (
    f"<transform><rotation>{' '.join(map(str, TURN.ravel()))}</rotation>"
    f"<translation>10 -20 30</translation><scale>{SCALE}</scale></transform>"
)


def sensor(values, number=0, kind="frame", size=(WIDTH, HEIGHT), more=""):
    numbers = "".join(f"<{key}>{value!r}</{key}>" for key, value in values.items())
    size = f'<resolution width="{size[0]}" height="{size[1]}"/>'
    return (
        f'<sensor id="{number}" type="{kind}">{size}{more}'
        '<calibration class="initial"><f>1</f></calibration>'
        f'<calibration class="adjusted" type="{kind}">{size}{numbers}</calibration></sensor>'
    )


def camera(i, more="", inside="", placed=True, chunk=False):
    """One of the given cameras, in a chunk that lies in the world as CHUNK says, or is it."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = GIVEN.R[i].numpy().T, GIVEN.centres[i].numpy()
    if chunk:
        pose[:3, :3] = TURN.T @ pose[:3, :3]
        pose[:3, 3] = TURN.T @ (pose[:3, 3] - SHIFT) / SCALE
    transform = f"<transform>{' '.join(map(repr, pose.ravel().tolist()))}</transform>" * placed
    sensors = "" if "sensor_id" in more else 'sensor_id="0"'
    return f'<camera id="{i}" label="{NAMES[i]}.JPG" {sensors} {more}>{transform}{inside}</camera>'


def write(tmp_path, sensors, rows, after="", version="1.5.0", components=""):
    path = tmp_path / "cameras.xml"
    path.write_text(
        f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="{version}"><chunk>'
        f"<sensors>{sensors}</sensors>{components}<cameras>{''.join(rows)}</cameras>{after}"
        "</chunk></document>"
    )
    return path


def project(i, value, old=False):
    """By the manuals' appendix, of version 1.2 and of before: [points, 2] pixels."""
    seen = POINTS @ GIVEN.R[i].numpy().T + GIVEN.t[i].numpy()
    x, y = (seen[:, :2] / seen[:, 2:]).T
    v = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2", "skew"), 0.0) | value
    r2 = x**2 + y**2
    radial = 1 + v["k1"] * r2 + v["k2"] * r2**2 + v["k3"] * r2**3 + v["k4"] * r2**4
    p1, p2 = (v["p2"], v["p1"]) if old else (v["p1"], v["p2"])
    xd = x * radial + p1 * (r2 + 2 * x**2) + 2 * p2 * x * y
    yd = y * radial + p2 * (r2 + 2 * y**2) + 2 * p1 * x * y
    if old:
        pixels = v["cx"] + xd * v["fx"] + yd * v["skew"], v["cy"] + yd * v["fy"]
    else:
        u = WIDTH / 2 + v["cx"] + xd * (v["f"] + v["b1"]) + yd * v["b2"]
        pixels = u, HEIGHT / 2 + v["cy"] + yd * v["f"]
    return np.stack(pixels, axis=1)


def see(found, i):
    """Where the found camera, behind its lens, sees POINTS in the working image."""
    R, t = found.R[i].numpy(), found.t[i].numpy()
    seen = POINTS @ R.T + t
    points = seen[:, :2] / seen[:, 2:]
    points = points if found.lenses[i] is None else found.lenses[i].distort(points)
    K = found.K[i].numpy()
    return points @ K[:2, :2].T + K[:2, 2]


def test_sensors_with_their_lenses_and_a_chunk_in_the_world(tmp_path):
    other = {"f": 650, "cx": -5, "cy": 3} | LENS | SKEWED
    rows = [camera(i, f'sensor_id="{i % 2}"', chunk=True) for i in range(4)]
    path = write(tmp_path, sensor(NEW) + sensor(other, 1), rows, after=CHUNK)
    attempt = attempt_from_file(tmp_path, views())
    assert (attempt.figures["file"], attempt.warnings) == (str(path), ())
    for i in range(4):
        expected = to_working(project(i, other if i % 2 else NEW))
        np.testing.assert_allclose(see(attempt.cameras, i), expected, atol=1e-8)
    assert attempt.cameras.lenses[0] is None


def test_a_file_of_before_version_1_2(tmp_path):
    value = {"fx": 710, "fy": 700, "cx": 331, "cy": 228, "skew": 2} | LENS
    path = write(tmp_path, sensor(value), map(camera, range(4)), version="1.1.0")
    found = attempt_from_file(path, views()).cameras
    np.testing.assert_allclose(see(found, 2), to_working(project(2, value, old=True)), atol=1e-8)


def test_a_version_that_its_numbers_contradict(tmp_path):
    """331 right of the middle lies outside of 640 x 480; -12 above its corner too."""
    value = {"f": 700, "cx": 331, "cy": 228}
    found = attempt_from_file(write(tmp_path, sensor(value), map(camera, range(4))), views())
    expected = to_working(project(1, value | {"cx": 11, "cy": -12}))
    np.testing.assert_allclose(see(found.cameras, 1), expected, atol=1e-8)
    path = write(tmp_path, sensor(NEW), map(camera, range(4)), version="1.1.0")
    np.testing.assert_allclose(see(attempt_from_file(path, views()).cameras, 1), expected)


def test_a_fisheye(tmp_path):
    value = NEW | LENS
    path = write(tmp_path, sensor(value, kind="fisheye"), map(camera, range(4)))
    found = attempt_from_file(path, views()).cameras
    seen = POINTS @ GIVEN.R[3].numpy().T + GIVEN.t[3].numpy()
    r = np.linalg.norm(seen[:, :2] / seen[:, 2:], axis=1, keepdims=True)
    x, y = (seen[:, :2] / seen[:, 2:] * np.arctan(r) / r).T
    t2 = x**2 + y**2
    radial = 1 + 0.1 * t2 - 0.02 * t2**2 + 0.01 * t2**3 + 0.003 * t2**4
    u = x * radial + 0.004 * (t2 + 2 * x**2) - 0.006 * x * y
    v = y * radial - 0.003 * (t2 + 2 * y**2) + 0.008 * x * y
    expected = 700 * np.stack([u, v], axis=1) + [WIDTH / 2 + 11, HEIGHT / 2 - 12]
    np.testing.assert_allclose(see(found, 3), to_working(expected), atol=1e-8)


def test_photographs_that_were_made_smaller_since(tmp_path):
    """5184 x 3456 becomes 1000 x 667, which 3456 / 5.184 is but for rounding."""
    value = {"f": 7000, "cx": 0, "cy": 0}
    path = write(tmp_path, sensor(value, size=(5184, 3456)), map(camera, range(4)))
    attempt = attempt_from_file(path, views(NAMES, 1000, 667))
    assert "for 5184x3456 pixels are scaled to the photographs' 1000x667" in attempt.warnings[0]
    scale = 64 / 1000
    np.testing.assert_allclose(attempt.cameras.K[0, 0, 0], 7000 / 5184 * 1000 * scale)
    np.testing.assert_allclose(attempt.cameras.K[0, :2, 2], [32, 31.5])  # rows 10 to 53


def test_what_was_not_aligned_or_is_disabled_has_no_camera(tmp_path):
    six = (*NAMES, "x", "y")
    rows = [
        camera(0),
        f'<group label="ring">{camera(1)}</group>',
        camera(2),
        camera(3, 'enabled="false"'),
        '<camera id="8" label="x.JPG" sensor_id="0" enabled="true"/>',
        '<camera id="9" label="y.JPG" sensor_id="7" enabled="true"/>',
    ]
    attempt = attempt_from_file(write(tmp_path, sensor(NEW), rows), views(six))
    assert attempt.cameras.views == NAMES[:3]
    assert set(attempt.dropped) == {NAMES[3], "x", "y"}


def test_of_several_components_the_one_of_most_photographs(tmp_path):
    components = (
        f'<components><component id="0">{CHUNK}</component><component id="1"/></components>'
    )
    rows = [camera(0, 'component_id="1"')]
    rows += [camera(i, 'component_id="0"', chunk=True) for i in (1, 2, 3)]
    path = write(tmp_path, sensor(NEW), rows, components=components)
    attempt = attempt_from_file(path, views())
    assert attempt.cameras.views == NAMES[1:]
    np.testing.assert_allclose(see(attempt.cameras, 0), to_working(project(1, NEW)), atol=1e-8)
    assert attempt.warnings[0] == (
        f"{path}: holds 2 reconstructions that do not join; of the 4 photographs component 1 1, "
        "component 0 3. That of most is taken, component 0"
    )


@pytest.mark.parametrize(
    ("orientation", "upright"),
    [
        (6, lambda x, y: (HEIGHT - y, x)),
        (8, lambda x, y: (y, WIDTH - x)),
        (3, lambda x, y: (WIDTH - x, HEIGHT - y)),
    ],
)
def test_photographs_that_exif_turns(tmp_path, orientation, upright):
    inside = f"<orientation>{orientation}</orientation>"
    rows = [camera(i, inside=inside) for i in range(4)]
    path = write(tmp_path, sensor(NEW | LENS), rows)
    lying = orientation != 3
    width, height = (HEIGHT, WIDTH) if lying else (WIDTH, HEIGHT)
    found = attempt_from_file(path, views(NAMES, width, height)).cameras
    expected = np.stack(upright(*project(2, NEW | LENS).T), axis=1)
    expected = expected / 10 + ([8, 0] if lying else [0, 8])
    np.testing.assert_allclose(see(found, 2), expected, atol=1e-8)
    if lying:  # saved anew as the pixels lie, they need no turn
        found = attempt_from_file(path, views()).cameras
        np.testing.assert_allclose(see(found, 2), to_working(project(2, NEW | LENS)), atol=1e-8)


def test_a_pinhole_projects_as_any(tmp_path):
    found = attempt_from_file(write(tmp_path, sensor(NEW), map(camera, range(4))), views()).cameras
    assert_seen(found, np.stack([project(i, NEW) for i in range(4)]))


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        (sensor(NEW, kind="spherical"), "a camera of type 'spherical' cannot be read"),
        (sensor(NEW, kind="equisolid_fisheye"), "type 'equisolid_fisheye' cannot be read"),
        (sensor(NEW | {"p3": 0.1}), "its calibration has p3 = 0.1, which cannot be read"),
        (sensor(NEW | {"zeta": 0.1}), "its calibration has zeta = 0.1"),
        (sensor(NEW | {"f": float("nan")}), "f: should be finite numbers"),
        (sensor(NEW | {"f": -700}), "should be positive"),
        (sensor(NEW, 1), "its sensor '0' is not in the file"),
        (sensor(NEW, size=(0, 480)), "resolution should be pixels, not 0 x 480"),
        ('<sensor id="0" type="frame"/>', "has no calibration"),
        (
            sensor(NEW, more='<property name="rolling_shutter" value="true"/>'),
            "has a rolling shutter",
        ),
    ],
)
def test_a_sensor_that_is_not_read_is_named(tmp_path, sensors, message):
    path = write(tmp_path, sensors, map(camera, range(4)))
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(path, views())
    assert str(error.value).startswith(str(path))


BOMB = (
    '<!DOCTYPE d [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'
    "<document version='1.5.0'><chunk>&b;</chunk></document>"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "has a DOCTYPE, which no file of cameras needs"),
        (BOMB.encode("utf-16"), "has a DOCTYPE"),
        ("<document><chunk>", "cannot be read as XML: no element found"),
        (b"<?xml version='1.0' encoding='x'?><document/>", "cannot be read as XML"),
        ("<document version='1.5'/>", "has no camera with a transform"),
        ("<document version='x'/>", "has no camera with a transform"),
        ("<BlocksExchange/>", "is ContextCapture's blocks .BlocksExchange., which is not read"),
        ("<scene/>", "holds 'scene', not Metashape's 'document'"),
        ("<a>" * 100_000 + "</a>" * 100_000, "holds 'a', not"),
    ],
)
def test_xml_that_is_none_of_its(tmp_path, text, message):
    path = tmp_path / "cameras.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(path, views())
    assert str(error.value).startswith(str(path))
