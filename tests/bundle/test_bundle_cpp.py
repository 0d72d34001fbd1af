"""The reader in a C++ program: the same values and verdicts as in Python; h5py reads the same."""

import json
import random

import bundles
import damage
import fuzz_bundle
import hostile
import keyfolders
import pytest
from conftest import ROOT, need_header, need_program, output
from docs_modules import load

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
    output("cmake", "-S", source, "-B", folder, f"-Dvfplan_DIR={vfplan.cmake_dir()}")
    output("cmake", "--build", folder, timeout=900)
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
        return output(program, *words, input=text, timeout=300).strip("\n")

    return run


def test_the_program_agrees_with_the_conformance_kit(bundle_info, tmp_path):
    write_kit(tmp_path)
    reader = runner.command_reader([str(bundle_info), "--values"], refused=(3, 4))
    assert not [result for result in runner.judge(tmp_path, reader) if result.problem]


@pytest.mark.parametrize("name", MAKE)
def test_json_equals_that_of_vfplan_info(name, bundle_info, vfplan_cli, tmp_path):
    path = bundles.stored(tmp_path / "a.h5", getattr(bundles, name)())
    theirs = vfplan_cli("info", path, "--json").json
    for name in ("elapsed_s", "tick_work", "findings", "reviewed"):  # told otherwise
        theirs.pop(name, None)
    assert json.loads(output(bundle_info, path)) == theirs


@pytest.mark.parametrize("what", ["missing", "corrupt"])
def test_the_program_fails_with_the_same_exit_code(what, bundle_info, vfplan_cli, tmp_path):
    path = tmp_path / "a.h5"
    if what == "corrupt":
        path.write_bytes(b"VFPLSEAL" + bytes(600))
    theirs = vfplan_cli("info", path, "--json")
    ours = json.loads(output(bundle_info, path, code=theirs.code))
    assert ours["error"]["kind"] == theirs.json["error"]["kind"]


def test_constants_and_documentation_are_those_of_the_schema():
    make_format = load(ROOT / "docs" / "make_format.py")
    assert make_format.HEADER.read_text() == make_format.header(), "run `make docs`"
    text = make_format.PAGE.read_text()
    assert text == make_format.page(text), "run `make docs`"
    assert make_format.rows_table() in text
    assert make_format.sizes_table() in text


@pytest.mark.parametrize(
    "components, target", [("", "headers"), ("COMPONENTS hdf5", "hdf5"), ("", "vfplan")]
)
def test_a_program_reads_bundles_without_a_library(components, target, tmp_path):
    """By the reader's earlier names too, from when it needed libhdf5."""
    old = target == "hdf5"
    names, header = ("vfplan::hdf5", "hdf5") if old else ("vfplan::bundle", "bundle")
    (tmp_path / "main.cpp").write_text(
        f"#include <vfplan/{header}/fixture.hpp>\n"
        f"int main(int, char** argv) {{ return int({names}::read_fixture(argv[1]).size()); }}\n"
    )
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.24)\nproject(plain LANGUAGES CXX)\n"
        f"find_package(vfplan REQUIRED {components})\n"
        "if(HDF5_FOUND)\n  message(FATAL_ERROR found)\nendif()\n"
        f"add_executable(plain main.cpp)\ntarget_link_libraries(plain PRIVATE vfplan::{target})\n"
    )
    program = build(tmp_path, tmp_path / "b", "plain")
    needs = output("ldd", program)
    assert "hdf5" not in needs
    if target == "headers":
        assert "crypto" not in needs
    output(program, bundles.stored(tmp_path / "a.h5", bundles.minimal()), code=12)


def python_verdict(data):
    try:
        read_bundle(data)
    except BundleError as error:
        return f"{error.kind} {error.where or ''}"
    return "ok"


@pytest.mark.parametrize("kind", ["hostile", "mutated"])
def test_both_readers_judge_bad_files_alike(kind, bundle_sweep, tmp_path):
    """The same verdict, the same kind of error, at the same place; one crash fails it all.

    Mutated: files whose object headers were edited and carry good checksums.
    """
    if kind == "hostile":
        files = {name: data for name, data, _ in hostile.files()}
    else:
        seeded = ((k, fuzz_bundle.mutated(hostile.sound(), random.Random(k))) for k in range(400))
        files = {str(number): damage.sealed(data) for number, data in seeded}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    paths = "".join(f"{tmp_path / name}\n" for name in files)
    found = bundle_sweep("verdicts", text=paths).split("\n")
    wanted = {name: python_verdict(data) for name, data in files.items()}
    assert dict(zip(files, found, strict=True)) == wanted


FOLDER = ROOT / "tests" / "data" / "bundles"
SIGNED, KEYS = FOLDER / "2.0-signed.h5", FOLDER / "signed.pub"
DEMANDED = ["case 17", "R-0042", 10**10]


@pytest.mark.parametrize(
    "for_whom, code",
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
    keys = keyfolders.keys_beside(name, tmp_path)
    wanted = "ok" if keyfolders.BESIDE[name][1] is None else "input"
    assert bundle_sweep("verify", SIGNED, keys, *DEMANDED) == wanted


def test_no_byte_of_a_signed_bundle_can_be_changed(bundle_sweep):
    """Neither as it is nor with all digests made anew."""
    found = bundle_sweep("forgeries", SIGNED, KEYS)
    assert len(found) == 2 * SIGNED.stat().st_size
    assert set(found[0::2]) == {"."}
    assert set(found[1::2]) == {".", "="}
    assert found.count("=") == 32  # the seal's own digest, which is then the right one again
