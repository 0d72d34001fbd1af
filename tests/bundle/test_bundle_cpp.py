"""The reader in a C++ program: the same values and verdicts as in Python; h5py reads the same."""

import importlib.util
import json
import random
import subprocess

import bundles
import damage
import fuzz_bundle
import hostile
import keyfolders
import pytest
from conftest import ROOT, need_header, need_program

import vfplan
from vfplan.bundle.read import read_bundle
from vfplan.bundle.seal import keygen, sign
from vfplan.conformance import __main__ as runner
from vfplan.conformance.kit import write_kit
from vfplan.errors import BundleError

pytestmark = pytest.mark.slow

MAKE = ("minimal", "small", "whole", "sheet", "pixels", "patient", "doubtful", "reviewed")


def build(source, folder, target):
    """Build a program against the installed package by CMake."""
    need_program("g++", "g++")
    for command in (
        ["cmake", "-S", source, "-B", folder, f"-Dvfplan_DIR={vfplan.cmake_dir()}"],
        ["cmake", "--build", folder],
    ):
        done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return folder / target


@pytest.fixture(scope="module")
def bundle_info(tmp_path_factory):
    """The sample program samples/bundle_info."""
    folder = tmp_path_factory.mktemp("bundle_info")
    return build(ROOT / "samples" / "bundle_info", folder, "bundle_info")


@pytest.fixture(scope="module")
def bundle_sweep(tmp_path_factory):
    """tests/native/bundle_sweep.cpp: many damaged files in one process."""
    folder = tmp_path_factory.mktemp("bundle_sweep")
    (folder / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.24)\nproject(sweep LANGUAGES CXX)\n"
        "set(CMAKE_BUILD_TYPE Release)\nfind_package(vfplan REQUIRED COMPONENTS sign)\n"
        f"add_executable(bundle_sweep {ROOT}/tests/native/bundle_sweep.cpp)\n"
        "target_link_libraries(bundle_sweep PRIVATE vfplan::sign)\n"
    )
    need_header("openssl/evp.h", "libssl-dev")
    program = build(folder, folder / "build", "bundle_sweep")

    def run(*words, text=None):
        command = [*map(str, (program, *words))]
        done = subprocess.run(
            command, input=text, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, f"died of {done.returncode}: {done.stderr}"
        return done.stdout.strip("\n")

    return run


@pytest.fixture
def write(tmp_path):
    """A bundle of one of the made-up fixtures, by its name."""

    def to_file(name):
        vfplan.write_fixture(getattr(bundles, name)(), tmp_path / f"{name}.h5")
        return tmp_path / f"{name}.h5"

    return to_file


def test_the_program_agrees_with_the_conformance_kit(bundle_info, tmp_path):
    write_kit(tmp_path)
    reader = runner.command_reader([str(bundle_info), "--values"], refused=(3, 4))
    assert not [result for result in runner.judge(tmp_path, reader) if result.problem]


@pytest.mark.parametrize("name", MAKE)
def test_json_equals_that_of_vfplan_info(name, bundle_info, vfplan_cli, write):
    path = write(name)
    for options in ([], ["--values"]):
        theirs = vfplan_cli("info", path, "--json", *options).json
        for name in ("elapsed_s", "tick_work", "findings", "reviewed"):  # told otherwise
            theirs.pop(name, None)
        ours = subprocess.run([bundle_info, path, *options], capture_output=True, check=True)
        assert json.loads(ours.stdout) == theirs


@pytest.mark.parametrize("what", ["missing", "corrupt"])
def test_the_program_fails_with_the_same_exit_code(what, bundle_info, vfplan_cli, tmp_path):
    path = tmp_path / "a.h5"
    if what == "corrupt":
        path.write_bytes(b"VFPLSEAL" + bytes(600))
    theirs = vfplan_cli("info", path, "--json")
    ours = subprocess.run([bundle_info, path], capture_output=True, check=False)
    assert ours.returncode == theirs.code
    assert json.loads(ours.stdout)["error"]["kind"] == theirs.json["error"]["kind"]


def test_constants_and_documentation_are_those_of_the_schema():
    spec = importlib.util.spec_from_file_location("make_format", ROOT / "docs" / "make_format.py")
    make_format = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_format)
    assert make_format.HEADER.read_text() == make_format.header(), "run `make docs`"
    text = make_format.PAGE.read_text()
    assert text == make_format.page(text), "run `make docs`"
    assert make_format.rows_table() in text
    assert make_format.sizes_table() in text


@pytest.mark.parametrize(
    ("components", "target"),
    [
        ("", "vfplan::vfplan"),
        ("COMPONENTS hdf5", "vfplan::hdf5"),
        ("COMPONENTS engine", "vfplan::engine"),
    ],
)
def test_a_program_reads_bundles_without_a_library(components, target, tmp_path):
    """By the reader's earlier names too, from when it needed libhdf5."""
    old = "hdf5" in target
    names, header = ("vfplan::hdf5", "hdf5") if old else ("vfplan::bundle", "bundle")
    (tmp_path / "main.cpp").write_text(
        f"#include <vfplan/{header}/fixture.hpp>\n"
        f"int main(int, char** argv) {{ return int({names}::read_fixture(argv[1]).size()); }}\n"
    )
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.24)\nproject(plain LANGUAGES CXX)\n"
        f"find_package(vfplan REQUIRED {components})\n"
        "if(HDF5_FOUND)\n  message(FATAL_ERROR found)\nendif()\n"
        f"add_executable(plain main.cpp)\ntarget_link_libraries(plain PRIVATE {target})\n"
    )
    program = build(tmp_path, tmp_path / "b", "plain")
    needs = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout
    assert "hdf5" not in needs
    if not old:
        assert "crypto" not in needs
    path = tmp_path / "a.h5"
    vfplan.write_fixture(bundles.minimal(), path)
    assert subprocess.run([program, path], check=False).returncode == 12


def python_verdict(data):
    try:
        read_bundle(data)
    except BundleError as error:
        return f"{error.kind} {error.where or ''}"
    return "ok"


def test_both_readers_judge_the_hostile_corpus_alike(bundle_sweep, tmp_path):
    """The same verdict, the same kind of error, at the same place."""
    wanted, paths = [], []
    for name, data, _ in hostile.files():
        (tmp_path / name).write_bytes(data)
        paths.append(str(tmp_path / name))
        wanted.append(f"{name}: {python_verdict(data)}")
    found = bundle_sweep("verdicts", text="\n".join(paths) + "\n").split("\n")
    names = [path.rpartition("/")[2] for path in paths]
    assert [f"{n}: {v}" for n, v in zip(names, found, strict=True)] == wanted


@pytest.mark.parametrize(
    ("file", "words", "code"),
    [
        ("2.0-signed.h5", ["case 17", "R-0042", 10**10], "ok"),
        ("2.0-signed.h5", ["case 18", "R-0042", 10**10], "signature.case"),
        ("2.0-signed.h5", ["case 17", "R-0043", 10**10], "signature.robot"),
        ("2.0-signed.h5", ["case 17", "R-0042", 60], "signature.age"),
        ("2.0-everything.h5", ["case 17", "R-0042", 10**10], "signature.missing"),
    ],
)
def test_a_signature_is_demanded_in_cpp_too(file, words, code, bundle_sweep):
    folder = ROOT / "tests" / "data" / "bundles"
    assert bundle_sweep("verify", folder / file, folder / "signed.pub", *words) == code


@pytest.mark.parametrize(
    ("for_whom", "code"),
    [({"case": "17"}, "signature.robot"), ({"robot_serial": "R7"}, "signature.case")],
)
def test_a_bundle_for_nobody_in_particular_is_refused_in_cpp_too(
    for_whom, code, bundle_sweep, tmp_path
):
    plain, signed = tmp_path / "plain.h5", tmp_path / "signed.h5"
    vfplan.write_fixture(bundles.small(), plain)
    keys = keygen(tmp_path / "k")[0]
    sign(plain, signed, tmp_path / "k", **for_whom, despite_findings=True)
    assert bundle_sweep("verify", signed, keys, "17", "R7", 10**10) == code


@pytest.mark.parametrize("name", keyfolders.BESIDE)
def test_a_file_of_keys_holds_the_same_in_cpp(name, bundle_sweep, tmp_path):
    file = ROOT / "tests" / "data" / "bundles" / "2.0-signed.h5"
    keys = keyfolders.keys_beside(name, tmp_path)
    wanted = "ok" if keyfolders.BESIDE[name][1] is None else "input"
    assert bundle_sweep("verify", file, keys, "case 17", "R-0042", 10**10) == wanted


def test_a_forged_signature_does_not_hold_in_cpp_either(bundle_sweep, tmp_path):
    folder = ROOT / "tests" / "data" / "bundles"
    signed = (folder / "2.0-signed.h5").read_bytes()
    at = len(signed) - damage.SEAL + 72
    forged = damage.resealed(signed[:at] + bytes(64) + signed[at + 64 :], damaged_seal=True)
    (tmp_path / "a.h5").write_bytes(forged)
    words = ["case 17", "R-0042", 10**10]
    found = bundle_sweep("verify", tmp_path / "a.h5", folder / "signed.pub", *words)
    assert found == "signature.wrong"


def test_no_byte_of_a_signed_bundle_can_be_changed(bundle_sweep):
    """Neither as it is nor with all digests made anew."""
    folder = ROOT / "tests" / "data" / "bundles"
    path = folder / "2.0-signed.h5"
    found = bundle_sweep("forgeries", path, folder / "signed.pub")
    assert len(found) == 2 * path.stat().st_size
    assert set(found[0::2]) == {"."}
    assert set(found[1::2]) == {".", "="}
    assert found.count("=") == 32  # the seal's own digest, which is then the right one again


def test_both_readers_judge_mutated_files_alike(bundle_sweep, tmp_path):
    """Files whose object headers were edited and carry good checksums; one crash fails it all."""
    good, wanted, paths = hostile.sound(), [], []
    for number in range(400):
        data = damage.sealed(fuzz_bundle.mutated(good, random.Random(number)))
        (tmp_path / str(number)).write_bytes(data)
        paths.append(str(tmp_path / str(number)))
        wanted.append(python_verdict(data))
    assert bundle_sweep("verdicts", text="\n".join(paths) + "\n").split("\n") == wanted


@pytest.mark.parametrize(("name", "step"), [("whole", 1), ("large", 40_009)])
def test_a_flipped_bit_is_refused_by_the_seal(name, step, bundle_sweep, write):
    assert set(bundle_sweep("flips", write(name), 0, step)) == {"."}


@pytest.mark.parametrize(("name", "step"), [("whole", 1), ("large", 40_009)])
def test_a_flipped_bit_under_a_good_seal_crashes_nothing(name, step, bundle_sweep, write):
    """What is read of them, the Python tests compare with h5py."""
    assert "." in bundle_sweep("flips", write(name), 0, step, "reseal")


def test_every_prefix_is_refused(bundle_sweep, write):
    assert set(bundle_sweep("prefixes", write("whole"), 0, 1)) == {"."}


def test_every_prefix_of_the_payload_is_refused_under_a_seal_of_its_own(bundle_sweep, write):
    path = write("whole")
    length = len(path.read_bytes()) - damage.SEAL
    found = bundle_sweep("prefixes", path, 0, 1, "reseal")
    assert set(found[: length - 7] + found[length + 1 :]) == {"."}
    assert found[length] == "="


def test_both_readers_judge_every_resealed_flip_alike(bundle_sweep, write):
    path = write("small")
    data = path.read_bytes()
    wanted = read_bundle(data)[0]
    ours = "".join(
        damage.verdict(damage.flipped(data, i, True), wanted) for i in range(0, len(data), 7)
    )
    assert ours == bundle_sweep("flips", path, 0, 7, "reseal")
