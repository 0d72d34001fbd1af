"""The wall in a camera's picture: rendered frames whose truth is known, and real photographs."""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path

import bundles
import camera_scene as scene
import cv2
import numpy as np
import pytest
from camera_scene import CAMERA
from chromium import Page
from conftest import file_with, free_port, names_in, need_program
from refusals import refuses
from replays import fixture_of, write_session

from vfplan.bundle.write import write_fixture
from vfplan.camera.command import ticks_to_show
from vfplan.camera.overlay import Overlay
from vfplan.camera.pose import Camera, find_tags, locate, make_finder, read_camera
from vfplan.camera.sheet import (
    DICTIONARY,
    cut_words,
    draw_board,
    draw_print,
    plan_of,
    printed_tags,
    touched_tags,
)
from vfplan.errors import InputError, MarkerError
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.io.files import to_json_types
from vfplan.review import paper
from vfplan.review.plan import Plan
from vfplan.session.bags import TICK
from vfplan.session.session import Session

T = np.linspace(0, 1, 300)
LINE = np.column_stack([0.5 + 0.14 * T, 0.1 + 0.05 * np.sin(5 * T), np.full(300, 0.02)])
FIXTURE = fixture_of(LINE)
PLAN = plan_of(FIXTURE)
TAGS = printed_tags(PLAN)
PLACES = PLAN.place(LINE)


SESSION = Session(T, LINE + np.array([0, 0.003, 0]))


def write_film(path, frames):
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5, scene.SIZE)
    for frame in frames:
        film.write(frame)
    film.release()


def printed(fixture):
    return scene.page(draw_print(Plan.of(fixture, "plan.h5"), "a4")[0])


def photo(page, rng, **how):
    return scene.photograph(page, scene.pose(rng), rng, **how)


@pytest.fixture
def desk(tmp_path):
    """A folder with the plan, a session and the camera's calibration."""
    write_fixture(FIXTURE, tmp_path / "plan.h5")
    write_session(tmp_path / "s.csv", SESSION)
    (tmp_path / "calib.json").write_text(json.dumps(to_json_types(asdict(CAMERA))))
    return tmp_path


@pytest.fixture(scope="module")
def page():
    return printed(FIXTURE)


LENS = CAMERA.camera_matrix, CAMERA.distortion_coefficients


def off_m(pixels, lens, T, places):
    """(N,) how far pixels (N, 2) lie from these places, where they are carried onto the page."""
    rays = cv2.undistortPoints(pixels[:, None], *lens)[:, 0]
    x, y, w = np.linalg.solve(T[:3, [0, 1, 3]], np.column_stack([rays, np.ones(len(rays))]).T)
    return np.hypot(x / w - places[:, 0], y / w - places[:, 1])


@pytest.mark.parametrize("frames", [24, pytest.param(200, marks=pytest.mark.slow)])
def test_the_line_is_drawn_where_it_is(page, frames):
    overlay = Overlay(PLAN, TAGS, CAMERA)
    errors, bounds = np.zeros(frames), np.zeros(frames)
    for number in range(frames):
        rng = np.random.default_rng(number)
        T_true = scene.pose(rng)
        hands = [(rng.uniform(-0.1, 0.1, 2), rng.uniform(0.02, 0.05)) for _ in range(number % 3)]
        report, pose = overlay.see(scene.photograph(page, T_true, rng, covered=hands))
        errors[number] = 1e3 * off_m(pose.project(PLACES), LENS, T_true, PLACES).max()
        bounds[number] = report["bound_mm"]
        assert report["refused"] == (None if bounds[number] <= 0.5 else "bound-too-large")
    assert np.quantile(errors, 0.95) <= 0.3
    assert 0.95 <= (errors <= bounds).mean() <= {24: 1.0, 200: 0.99}[frames]


def hands(*kept):
    """On all tags but some."""
    return [(tag[:, :2].mean(axis=0), 0.02) for k, tag in enumerate(TAGS.values()) if k not in kept]


# Code -> the page, what hides it, and what is set otherwise.
REFUSED = {
    "no-tag": (lambda page: page, hands(), {}),
    "one-tag": (lambda page: page, hands(1), {}),
    "other-sheet": (lambda page: printed(fixture_of(LINE, stiffness=999.0)), (), {}),
    "print-stretched": (lambda page: cv2.resize(page, None, fx=1.0, fy=0.992), (), {}),
    "wrong-scale": (lambda page: page, (), {"measured_mm": 97.0}),
    "bound-too-large": (lambda page: page, (), {"limit_mm": 1e-3}),
    "tags-misplaced": (lambda page: page, (), {"tags": dict.fromkeys(TAGS, np.zeros((4, 3)))}),
    "camera-size": (lambda page: page, (), {"camera": replace(CAMERA, image_width=640)}),
}


@pytest.mark.parametrize("code", REFUSED)
def test_a_refused_frame_says_why_and_shows_no_wall(page, code):
    make, covered, settings = REFUSED[code]
    page = make(page)
    overlay = Overlay(PLAN, **({"tags": TAGS, "camera": CAMERA} | settings))
    for number in range(3):
        frame = photo(page, np.random.default_rng(number), covered=covered)
        before = frame.copy()
        assert overlay.show(frame, 0.0)["refused"] == code
        assert np.array_equal(frame[30:], before[30:])


@pytest.mark.parametrize("measured_mm, is_red", [(None, True), (100.0, False)])
def test_a_frame_says_that_nobody_measured_the_scale_which_no_camera_sees(
    page, measured_mm, is_red
):
    frame = photo(page, np.random.default_rng(0))
    narrow = frame[:, :500].copy()
    for seen in (frame, narrow):
        Overlay(PLAN, TAGS, CAMERA, measured_mm=measured_mm).show(seen, 0.0)
    assert (frame[:30] == paper.WALL_COLOUR).all(axis=2).any() == is_red
    assert (narrow[:30, -4:] == 255).all()
    # A print of 97 % at 97 % of the distance gives the same picture.
    shift = np.array([0.01, -0.02, 0.4])
    near, far = (
        CAMERA.project(s * PLACES, np.hstack([0 * s, 0.1, 0.2, s * shift]))[0] for s in (0.97, 1.0)
    )
    assert np.allclose(near, far, atol=1e-9)


def test_a_sheet_is_printed_in_true_millimetres_or_refused(desk, vfplan_cli):
    for name, size_mm in (("a4", (210, 297)), ("letter", (215.9, 279.4))):
        words = "review", "plan.h5", "--print-out", f"{name}.pdf", "--paper", name
        assert vfplan_cli(*words, cwd=desk).sound
        made = (desk / f"{name}.pdf").read_bytes()
        box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", made)
        assert np.allclose(np.array(box.groups(), float) * 25.4 / 72, size_mm, atol=1e-3)
    # A turn and a shift carry the line onto the sheet, and its tags are 28 mm wide.
    assert np.allclose(step_lengths(PLACES), step_lengths(LINE))
    corners = np.array(list(TAGS.values()))
    assert np.allclose(np.linalg.norm(corners[:, 1:] - corners[:, :-1], axis=2), 0.028)
    with refuses(InputError, code="sheet-too-small"):
        printed_tags(plan_of(fixture_of(2 * LINE)))
    with refuses(InputError, code="no-plane"):
        plan_of(fixture_of(LINE, axis=None))
    # A word on the case is no other plan.
    assert plan_of(replace(FIXTURE, case="C1")).digest == PLAN.digest


def test_a_print_says_what_it_is_of_and_what_of_its_slice_has_no_room():
    approved = replace(FIXTURE, reviewed=bundles.reviewed().reviewed)
    for fixture, case, words in (
        (FIXTURE, "", "p.h5, no named case, approved by nobody"),
        (approved, "C$1$", "p.h5, case C$1$, approved by A. Planner, "),
        (replace(FIXTURE, case="C2"), "C1", "p.h5, case C2, approved by nobody"),
    ):
        shown = Plan.of(fixture, "p.h5")
        figure, cut = draw_print(shown, "a4", case)
        first, digest = figure.axes[0].texts[0].get_text().split("\n")
        assert first.startswith(words)
        assert (digest, cut) == (f"digest {shown.digest}", "")
    onto = np.array([[0.5, 0, -99.75], [0, 0.5, -49.75], [0, 0, 1]])
    assert cut_words(onto, (200, 400, 3), (200, 100)) == ""
    told = cut_words(onto, (200, 400, 3), (194, 159))
    assert told.startswith("The page holds 194 x 100 mm of the slice's 200 x 100 mm.")


def test_the_command_calibrates_and_shows_the_wall(page, desk, vfplan_cli):
    def run(*words):
        return vfplan_cli("ar", *words, "--json", cwd=desk)

    board, rng = scene.page(draw_board("a4")), np.random.default_rng(1)
    names = [f"board{k}.png" for k in range(12)]
    for name in names:
        picture = scene.photograph(board, scene.pose(rng, (0.3, 0.45)), rng, disturbed=False)
        cv2.imwrite(str(desk / name), picture)
    run(names[0], "--calibrate", "-o", "found.json").fails(3, error="calibration-weak")
    run(*names, "--calibrate", "-o", "found.json").sound  # noqa: B018
    found = json.loads((desk / "found.json").read_text())
    assert np.allclose(found["camera_matrix"], CAMERA.camera_matrix, atol=1.0)

    frames = [photo(page, rng) for _ in range(4)]
    frame = frames[-1]
    write_film(desk / "film.avi", frames)
    cv2.imwrite(str(desk / "photo.png"), frame)
    more = "--camera", "found.json", "--session", "s.csv", "--measured-mm", 100, "-o"
    for source, out, frames in (("photo.png", "wall.png", 1), ("film.avi", "wall.mp4", 4)):
        shown = run("plan.h5", source, *more, out).sound.json
        assert (shown["refused"], shown["shown"], shown["frames"]) == (None, frames, frames)
        assert shown["reprojection_px"] < 0.5
        assert np.shape(shown["pose_T_camera_sheet"]) == (4, 4)
        made = cv2.VideoCapture(str(desk / out))
        assert len(list(iter(lambda film=made: film.read()[0], False))) == frames
    cv2.imwrite(str(desk / "grey.png"), np.full_like(frame, 128))
    write_film(desk / "blank.avi", [np.full_like(frame, 128)])
    for source, out in (("grey.png", "no.png"), ("blank.avi", "no.mp4")):
        told = run("plan.h5", source, *more, out).fails(1).json
        assert (told["refused"], told["output"]) == ("no-tag", None)
        assert not (desk / out).exists()
    run("plan.h5", "photo.png").fails(3, error="camera-uncalibrated")
    run("plan.h5", "photo.png", "--camera", "s.csv").fails(3, error="calibration-file")
    (desk / "text.png").write_text("text")
    for source in ("s.csv", "text.png", "97"):
        # In one line.
        run("plan.h5", source, *more[:2]).fails(3, "gives no frame", error="camera-source")
    same = f"../{desk.name}/photo.png"
    run("plan.h5", same, *more, "photo.png", "--overwrite").fails(2, error="output-is-input")
    os.mkfifo(desk / "pipe")
    run("pipe", "--calibrate", "-o", "c.json").fails(3, error="not-a-file")


# Numbers that no calibration has, by their field; of the matrix one at a place of its own.
WRONG = {
    **dict.fromkeys(("image_width", "image_height"), (0, -640, 640.5, np.inf)),
    "camera_matrix": [{}, [[1, 2], [3]]],
    "distortion_coefficients": [[0] * 3, [0, 0, 0, 0, np.nan], [np.inf] * 4, ["x"] * 500],
}
WRONG_AT = {(0, 0): (0, -1), (1, 1): (-1, np.inf), (0, 1): (1e-3,), (1, 0): (1e-3,),
            (2, 0): (1,), (2, 2): (0.5,), (0, 2): (np.nan,)}  # fmt: skip
for at, numbers in WRONG_AT.items():
    for number in numbers:
        matrix = CAMERA.camera_matrix.copy()
        matrix[at] = number
        WRONG["camera_matrix"].append(matrix.tolist())


def test_a_calibration_is_read_as_ros_nests_it_too(tmp_path):
    data = to_json_types(asdict(CAMERA))
    nested = {name: data[name] for name in ("image_width", "image_height")}
    for name, columns in (("camera_matrix", 3), ("distortion_coefficients", 5)):
        values = np.ravel(data[name]).tolist()
        nested[name] = {"rows": len(values) // columns, "cols": columns, "data": values}
    path = file_with(tmp_path / "ros.json", json.dumps(nested))
    camera = read_camera(path)
    assert np.array_equal(camera.camera_matrix, CAMERA.camera_matrix)
    assert np.array_equal(camera.distortion_coefficients, CAMERA.distortion_coefficients)
    for text, said in (
        ("image_width: 640", "it is no JSON file"),
        ("[" * 100000, "it is no JSON file"),
        ("[]", "image_width is missing"),
        *(
            (json.dumps(nested | {name: {"data": value}}), f"{name} is {str(value)[:250]}, not ")
            for name, values in WRONG.items()
            for value in values
        ),
    ):
        path.write_text(text)
        with refuses(InputError, "calibration-file") as refused:
            read_camera(path)
        assert f"{path}: is no calibration: {said}" in str(refused.value)
        assert "image_height, camera_matrix" in str(refused.value)


def test_a_frame_says_that_the_session_has_ended_and_a_run_without_a_tick_fails(
    page, desk, vfplan_cli
):
    cv2.imwrite(str(desk / "a.png"), photo(page, np.random.default_rng(0))[..., ::-1])

    def run(out, *words):
        usual = "--camera", "calib.json", "--measured-mm", 100, "-o", out
        return vfplan_cli("ar", "plan.h5", "a.png", *usual, *words, cwd=desk)

    def drawn(out, *words):
        assert run(out, *words).sound
        return cv2.imread(str(desk / out)).astype(int)

    plain = drawn("plain.png")
    during = drawn("during.png", "--session", "s.csv", "--session-start", 0.5)
    after = drawn("after.png", "--session", "s.csv", "--session-start", 1.01)
    assert (during[30:] != plain[30:]).any()
    assert (after[30:] == plain[30:]).all()
    assert (after[:30, :, 2] > after[:30, :, 0] + 50).any(), "words in red"
    source = f"udp://127.0.0.1:{free_port()}"
    silent = run("silent.png", "--live", source)
    assert silent.code == 1
    assert f"no tick of {source} came" in silent.stderr
    assert "next: then try again: vfplan ar" in silent.stdout
    assert not (desk / "silent.png").exists()
    with ExitStack() as stack:
        newest = ticks_to_show(stack, FIXTURE, "", {"session": None, "live_source": source})
        assert newest(0.0) == (None, f"No tick comes from {source}")


@pytest.mark.parametrize("words", [
    "--board-out b.pdf --port 3", "--board-out b.pdf x.h5", "p.h5 a.png --paper a4",
    "p.h5 0 --port 0", "p.h5 0 --session-start 1", "p.h5 a.png --seconds 1",
    "p.h5 0 --tags t.csv --measured-mm 99", "a.png --calibrate -o c.json --limit-mm 1",
    "p.h5 0 --session s.csv --live r.h5",
])  # fmt: skip
def test_an_option_without_effect_is_refused(words, vfplan_cli, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((9, 9), np.uint8))
    assert vfplan_cli("ar", *words.split(), cwd=tmp_path).code == 2
    assert names_in(tmp_path) == ["a.png"]


SHOWN = "document.getElementById('connection').textContent"


def test_a_page_shows_the_frames_with_the_tool_of_a_controller(page, desk):
    write_film(desk / "film.avi", 600 * [photo(page, np.random.default_rng(3))])
    tick = np.zeros(1, TICK)
    tick["hip"], tick["proxy"] = LINE[150] + [0, 0.003, 0], LINE[150] + [0, 0.006, 0]
    tick["normal"], tick["force"] = [0, 1, 0], [0, 3, 0]
    port = free_port()
    words = f"ar plan.h5 film.avi --camera calib.json --live udp://127.0.0.1:{port} --window"
    words = f"{words} --no-browser -o wall.png --json".split()
    run = subprocess.Popen([sys.executable, "-P", "-m", "vfplan", *words], cwd=desk,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip
    address = run.stderr.readline().strip()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        Page(need_program("chromium", "chromium"), desk / "profile") as browser,
    ):
        browser.open(address.partition("#")[0])
        browser.until(SHOWN, lambda words: words.startswith("the program has ended"))
        browser.open("about:blank")
        browser.open(address)
        browser.until("location.hash.length > 1 && document.getElementById('latency') !== null")
        number = 0

        def send_until_seen(words):
            nonlocal number
            tick["t"], number = number / 20, number + 1
            head = struct.pack("<4sHHQQ", b"VFPT", 1, 1, number, 0)
            sender.sendto(head + tick.tobytes(), ("127.0.0.1", port))
            return number > 40 and re.search(r"shown \d+ ms after it came", words)

        def send_to_the_end():
            while run.poll() is None:
                send_until_seen("")
                time.sleep(0.02)

        browser.until("document.getElementById('latency').textContent", send_until_seen)
        assert browser.run(SHOWN) == "wall shown"
        assert browser.run("document.getElementById('picture').width") == scene.SIZE[0]
        # Ticks come to the end, so that the last frame has one.
        with ThreadPoolExecutor() as pool:
            pool.submit(send_to_the_end)
            run.send_signal(signal.SIGINT)
            found = json.loads(run.communicate()[0])
    assert 0 < found["window_latency_ms"] < 2000
    wall = cv2.imread(str(desk / "wall.png"))
    T = np.array(found["pose_T_camera_sheet"])
    at = cv2.projectPoints(PLAN.place(tick["hip"]), cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], *LENS)[0]
    u, v = np.round(at.ravel()).astype(int)
    assert wall[v, u, ::-1].tolist() == list(paper.TIP_COLOUR)


def test_tags_on_the_object_are_touched_points_in_the_fixture_s_frame(page, tmp_path):
    back = np.linalg.inv(PLAN.T_sheet_fixture)
    rows = ["label,x_m,y_m,z_m"]
    for number, corners in TAGS.items():
        places = corners @ back[:3, :3].T + back[:3, 3]
        rows += [f"{number}.{k},{x},{y},{z}" for k, (x, y, z) in enumerate(places)]
    file = file_with(tmp_path / "tags.csv", "\n".join(rows))
    touched = touched_tags(file, PLAN)
    assert touched.keys() == TAGS.keys()
    assert all(np.allclose(touched[number], TAGS[number]) for number in TAGS)
    file.write_text("\n".join(rows[:-1]))
    with refuses(MarkerError, code="tag-corners"):
        touched_tags(file, PLAN)


@pytest.mark.parametrize("picture", [0, 3])
def test_corners_of_a_real_photograph_lie_where_the_pose_says(shared_data, picture):
    """A webcam's chessboard: four of its squares are tags, the corners between are held out."""

    def read(name):
        return np.loadtxt(shared_data / "photo_px_to_mm" / f"calib.{name}.txt")

    camera = Camera(640, 480, read("intrinsics"), read("distortion"))
    pixels = read(f"image_points.{picture}").reshape(10, 14, 2)
    places = read(f"object_points.{picture}").reshape(10, 14, 3) / 1e3
    quads = [(slice(v, v + 2), slice(u, u + 2)) for v in (0, 8) for u in (0, 12)]
    tags, found = ({k: corners[quad].reshape(4, -1)[[0, 1, 3, 2]] for k, quad in enumerate(quads)}
                   for corners in (places, pixels))  # fmt: skip
    pose = locate(found, tags, camera)
    off_px = row_lengths(pose.project(places.reshape(-1, 3)) - pixels.reshape(-1, 2))
    m_per_px = pose.vector[5] / camera.camera_matrix[0, 0]
    assert np.quantile(off_px, 0.95) * m_per_px < 0.3e-3


def test_a_published_photograph_of_a_board():
    """OpenCV's: its tags give the pose, and the corners of its squares are held out."""
    folder = Path(os.environ.get("OPENCV_DOC", "/usr/share/doc/opencv-doc"))
    if not folder.is_dir():
        pytest.skip("no photograph: install Debian's opencv-doc, or name its folder in OPENCV_DOC")
    frame = cv2.imread(str(folder / "opencv4/html/choriginal.jpg"), cv2.IMREAD_GRAYSCALE)
    board = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.02, DICTIONARY)
    settings = folder / "examples/aruco/tutorial_camera_charuco.yml"
    file = cv2.FileStorage(str(settings), cv2.FILE_STORAGE_READ)
    lens = [file.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients")]
    tags = dict(enumerate(np.array(board.getObjPoints(), float)))
    pose = locate(find_tags(make_finder(), frame), tags, Camera(640, 480, *lens))
    corners, numbers, *_ = cv2.aruco.CharucoDetector(board).detectBoard(frame)
    places = board.getChessboardCorners()[numbers.ravel()].astype(float)
    away_m = off_m(corners[:, 0], lens, pose.T_camera_sheet, places)
    assert len(away_m) == 24
    assert np.median(away_m) < 0.25e-3
    assert np.quantile(away_m, 0.95) < 0.55e-3
