"""Live: a controller's datagrams, OpenIGTLink to its last bit, MCAP and back."""

import errno
import itertools
import json
import resource
import signal
import socket
import struct
import subprocess
import sys
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import bundles
import numpy as np
import pytest
from click.testing import CliRunner
from conftest import ROOT, file_with, free_port, need_header, need_program, output
from motion import NATIVE, compiled, turned
from refusals import refuses
from replays import write_session
from vfplan.cli.main import cli

import vfplan
from vfplan.engine.moving import matrices
from vfplan.errors import InputError, SessionError, SettingError
from vfplan.live import server as igtl
from vfplan.live import sources
from vfplan.live.command import pose_warnings
from vfplan.live.server import Server, static_bodies
from vfplan.live.sources import PositionStream, decode, host_and_port, stream_udp
from vfplan.session import bags as mcapfile
from vfplan.session.bags import TICK, McapWriter, read_ticks
from vfplan.session.events import read_poses
from vfplan.session.read import open_session

needs_mcap = pytest.mark.skipif(find_spec("mcap") is None, reason="needs vfplan[live]")


def made(count):
    """The ticks that tests/native/telemetry.cpp publishes."""
    k = np.arange(count)
    ticks = np.zeros(count, TICK)
    ticks["index"], ticks["t"] = k, k / 1000
    for v, name in enumerate(("hip", "proxy", "normal", "force")):
        for i in range(3):
            ticks[name][:, i] = (k + 1) / (3 * v + i + 3)
    ticks["state"], ticks["status"] = k % 4 - 1, k % 8
    return ticks


@pytest.fixture(scope="module")
def publisher(tmp_path_factory):
    folder = tmp_path_factory.mktemp("telemetry")
    return compiled(folder, NATIVE / "telemetry.cpp", "-O2", "-Wconversion", "-pthread")


@pytest.mark.slow
def test_a_controllers_ticks_arrive_to_the_bit(publisher):
    port, count = free_port(), 2000
    source = stream_udp(f"udp://127.0.0.1:{port}")
    words = [publisher, str(port), str(count), "4096", "100"]
    run = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    parts, got = [], 0
    for ticks, counts in source:
        assert not any(counts.values())
        parts.append(ticks)
        got += len(ticks)
        if got == count or (run.poll() is not None and not len(ticks)):
            break
    assert "dropped 0 unsent 0" in run.communicate()[0]
    assert np.concatenate(parts).tobytes() == made(count).tobytes()


@pytest.mark.slow
def test_a_full_ring_drops_and_counts_and_never_waits(publisher):
    """A burst a thousand times the ring: most is dropped, the rest is told apart by its index."""
    assert int(output(publisher, free_port(), 4000, 4, 0).split()[1]) > 2000


def datagram(ticks, magic=b"VFPT", version=1, count=2):
    return struct.pack("<4sHHQQ", magic, version, count, 7, 3) + ticks.tobytes()


def with_tick(name, value):
    ticks = made(2)
    ticks[name][1] = value
    return datagram(ticks)


@pytest.mark.parametrize("data, code", [
    (datagram(made(2))[:20], "datagram-short"),
    (datagram(made(2))[:-1], "datagram-size"),
    (datagram(made(2)) + b"\0", "datagram-size"),
    (datagram(made(2), count=12), "datagram-size"),
    (datagram(made(2), magic=b"VFPX"), "datagram-unknown"),
    (datagram(made(2), version=2), "datagram-unknown"),
    (with_tick("force", [0, 0, np.nan]), "datagram-number"),
    (with_tick("t", 2e10), "datagram-number"),
])  # fmt: skip
def test_a_datagram_that_is_none_is_refused(data, code):
    with refuses(InputError, code):
        decode(data)


def test_a_sound_datagram_is_read():
    sequence, dropped, ticks = decode(datagram(made(2)))
    assert (sequence, dropped) == (7, 3)
    assert ticks.tobytes() == made(2).tobytes()
    assert decode(with_tick("t", 1.7e9))[2]["t"][1] == 1.7e9, "a time since 1970"


def sent(numbers, sender, port, first_t=0.0):
    """Datagrams of these numbers, one tick each, sent by a socket."""
    for k in numbers:
        tick = made(k + 1)[k:]
        tick["t"] += first_t
        head = struct.pack("<4sHHQQ", b"VFPT", 1, 1, k, 0)
        sender.sendto(head + tick.tobytes(), ("127.0.0.1", port))


# name: (datagrams of the first sender, of a second, whether that waits, ticks, lost, left out)
SENDERS = {
    "in order": ([*range(9)], [], False, 9, 0, 0),
    "swapped": ([0, 1, 3, 2, 4], [], False, 5, 0, 0),
    "lost": ([0, 1, 5], [], False, 3, 3, 0),
    "a second one": ([*range(5)], [*range(3)], False, 5, 0, 3),
    "begun again": ([*range(5)], [*range(3)], True, 8, 0, 0),
}


@pytest.mark.parametrize("name", SENDERS)
def test_one_sender_at_a_time_is_taken(name, monkeypatch):
    first, second, waits, count, lost, left_out = SENDERS[name]
    monkeypatch.setattr(sources, "SILENT_S", 0.2)
    port = free_port()
    source = stream_udp(f"udp://127.0.0.1:{port}")
    with (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
          socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two):  # fmt: skip
        sent(first, one, port)
        got = [next(source) for _ in first]
        time.sleep(0.3 * waits)
        sent(second, two, port, first_t=1.7e9)
        got += [next(source) for _ in second]
    assert sum(len(ticks) for ticks, _ in got) == count
    counts = got[-1][1]
    assert (counts["lost_datagrams"], counts["bad_datagrams"]) == (lost, left_out)
    assert ("a second program sends" in counts["first_bad_datagram"]) == (left_out > 0)


@needs_mcap
def test_a_recording_of_a_controller_that_began_again_is_one_session(tmp_path):
    path, ticks = tmp_path / "a.mcap", made(3000)
    with McapWriter(path) as writer:
        for part, begun in ((ticks, 1.7e9), (ticks[:1000], 1.7e9 + 10)):
            for k, tick in enumerate(part.reshape(-1, 1)):
                writer.write(tick, begun + k / 1000)
    session = vfplan.read_session(path)
    assert session.ticks == 4000
    assert np.diff(session.time).max() == pytest.approx(10 - 2.999)
    # A loop that runs faster than the clock stamps ticks of two runs alike.
    with McapWriter(path) as writer:
        writer.write(ticks, 1.7e9)
        writer.write(ticks, 1.7e9 + 1)
    assert np.count_nonzero(np.diff(read_ticks(path)["t"]) < 0) == 1
    assert vfplan.read_session(path).time[-1] < 10


@needs_mcap
def test_what_is_recorded_live_stands_under_its_name_while_it_runs(tmp_path):
    """And what is killed can be replayed, with its poses; nothing deletes it."""
    vfplan.write_fixture(bundles.small(), tmp_path / "f.h5")
    port, kept = free_port(), tmp_path / "k.mcap"
    words = [sys.executable, "-P", "-m", "vfplan", "live", tmp_path / "f.h5",
             f"udp://127.0.0.1:{port}", "--mcap", kept]  # fmt: skip
    part, table = tmp_path / "k.mcap.part", tmp_path / "p.csv.part"
    with (
        socket.create_server(("127.0.0.1", 0)) as poses,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        address = f"igtl://127.0.0.1:{poses.getsockname()[1]}/Body"
        more = ["--openigtlink", "0", "--poses-from", address, "--poses-out", table.with_suffix("")]
        run = subprocess.Popen([*map(str, words + more)], stderr=subprocess.PIPE)
        assert b"OpenIGTLink" in run.stderr.readline()
        tracker = poses.accept()[0]
        while not part.exists():
            time.sleep(0.05)
        sender.sendto(b"what is this", ("127.0.0.1", port))
        for k in range(100):
            sent(range(20 * k, 20 * k + 20), sender, port, first_t=7.0)
            tracker.sendall(igtl.transform("Body", time.time(), np.full(3, k)))
            time.sleep(0.02)
        size = 0
        while part.stat().st_size > size:
            size = part.stat().st_size
            time.sleep(0.3)
        run.kill()
        run.wait()
        run.stderr.close()
        tracker.close()
    assert len(read_ticks(part)) > 1000
    kept_x = read_poses(table).pose[:, 0]
    assert len(kept_x) > 50
    assert kept_x == pytest.approx(np.arange(len(kept_x)) / 1e3)
    moved = vfplan.replay(tmp_path / "f.h5", part, rule="robust", poses=table)
    assert moved.metrics["poses_refused"] == 0
    again = subprocess.run([*map(str, words)], capture_output=True, text=True)
    assert (again.returncode, "cut off" in again.stderr) == (2, True)
    idle = subprocess.run([*map(str, words[:-1]), tmp_path / "n.mcap", "--seconds", "0.3"],
                          capture_output=True, text=True)  # fmt: skip
    assert (idle.returncode, "no tick came" in idle.stderr) == (1, True)
    assert {one.name for one in tmp_path.iterdir()} == {"f.h5", part.name, table.name}


@pytest.mark.parametrize("address", [
    "udp:127.0.0.1:5", "udp://127.0.0.1", "tcp://127.0.0.1:5", "udp://127.0.0.1:99999",
    "igtl://127.0.0.1:5", "igtl://127.0.0.1:5/", "igtl://127.0.0.1:5/PatientReferenceToTracker",
])  # fmt: skip
def test_an_address_that_is_none_is_refused(address):
    """Also one of a device whose name no message can hold."""
    with refuses(SettingError, "address-invalid"):
        host_and_port(address, "igtl" if address.startswith("igtl") else "udp")
    assert host_and_port("igtl://127.0.0.1:5/StylusTipToReference", "igtl")[2][-3:] == "nce"


def test_crc_and_header_as_the_protocol_has_them():
    assert igtl.crc64(b"123456789") == 0x6C40DF5F0B497347, "the catalogue's check value"
    data = igtl.transform("vfplan_hip", 1.5, np.array([1.0, -2.0, 3.0]))
    version, kind, device, stamp, size, crc = igtl.HEADER.unpack_from(data)
    assert (version, kind.rstrip(b"\0"), device.rstrip(b"\0")) == (1, b"TRANSFORM", b"vfplan_hip")
    assert (stamp, size, crc) == (1 << 32 | 1 << 31, 48, igtl.crc64(data[58:]))
    assert struct.unpack(">12f", data[58:]) == (1, 0, 0, 0, 1, 0, 0, 0, 1, 1, -2, 3)


def messages(client):
    """(kind, device, body) one by one, each CRC checked."""

    def take(size):
        data = b""
        while len(data) < size:
            part = client.recv(size - len(data))
            if not part:
                raise ConnectionError
            data += part
        return data

    while True:
        _, kind, device, _, size, crc = igtl.HEADER.unpack(take(58))
        body = take(size)
        assert igtl.crc64(body) == crc
        yield kind.rstrip(b"\0").decode(), device.rstrip(b"\0").decode(), body


def connected(server):
    client = socket.create_connection(("127.0.0.1", server.port), timeout=60)
    return client, messages(client)


@pytest.fixture
def feed():
    return PositionStream(200.0)


@pytest.fixture
def server(feed):
    running = Server(bundles.whole(), 0, feed)
    yield running
    running.close()


def test_two_clients_one_that_stalls_and_one_that_comes_again(server, feed):
    fixture = bundles.whole()
    stalled, _ = connected(server)  # reads nothing, ever
    for _ in range(2):
        client, coming = connected(server)
        first = [next(coming) for _ in range(2)]
        devices = [("POLYDATA", "vfplan_cloud"), ("POLYDATA", "vfplan_contact")]
        assert [m[:2] for m in first] == devices
        body = first[0][2]
        count = struct.unpack(">I", body[:4])[0]
        assert count == len(fixture.points)
        sent = np.frombuffer(body, ">f4", 3 * count, 40).reshape(-1, 3)
        assert np.array_equal(sent, (igtl.TO_RAS * fixture.points).astype(">f4"))
        feed.put(made(3)[2:])
        kinds = [next(coming) for _ in range(4)]
        assert [m[:2] for m in kinds] == [
            ("TRANSFORM", "vfplan_hip"), ("TRANSFORM", "vfplan_proxy"),
            ("SENSOR", "vfplan_force"), ("STATUS", "vfplan_status"),
        ]  # fmt: skip
        force = np.frombuffer(kinds[2][2], ">f8", 3, 10)
        assert np.array_equal(force, made(3)[2]["force"] * [-1, -1, 1])
        client.sendall(igtl.message("GET_POLYDATA", "vfplan_cloud", 0.0, b""))
        assert next(m for m in coming if m[0] == "POLYDATA")[2] == body
        client.close()
    stalled.close()


def test_a_client_is_told_when_the_source_is_silent(server, feed, monkeypatch):
    monkeypatch.setattr("vfplan.live.server.SILENT_S", 0.3)
    monkeypatch.setattr(sources, "SILENT_S", 0.3)
    before = time.time()
    feed.put(made(1))
    for is_late in (False, True):
        client, coming = connected(server)
        kinds = [next(coming) for _ in range(3 if is_late else 7)][2:]
        assert [kind for kind, *_ in kinds] == ["STATUS"] if is_late else kinds[0][0] == "TRANSFORM"
        codes = [struct.unpack(">H", body[:2])[0] for kind, _, body in kinds if kind == "STATUS"]
        assert codes == ([13] if is_late else [igtl.OK, 13])
        client.close()
    tick = np.zeros(1, sources.SHOWN)[0]
    tick["received"] = before
    assert igtl.HEADER.unpack_from(igtl.tick_messages(tick))[3] >> 32 == int(before)


def test_a_feed_hands_out_its_rate_and_waits_for_nobody():
    feed, ticks = PositionStream(100.0), made(4000)
    assert feed.after(-1, 0.0) == (-1, [])
    seen, got = -1, []
    for block in ticks[:1000].reshape(-1, 8):
        feed.put(block)
        seen, new = feed.after(seen, 0.0)
        got += new
    assert [int(t["index"]) for t in got] == list(range(0, 1000, 10))
    assert feed.after(seen, 0.0) == (seen, [])
    for block in ticks[1000:].reshape(-1, 8):
        feed.put(block)
    late, new = feed.after(seen, 0.0)
    assert (late - seen, len(new), int(new[-1]["index"])) == (300, 50, 3990)
    assert [int(t["index"]) for t in feed.after(-1, 0.0)[1]] == [3990]
    feed.put(ticks[:1])  # a source that begins again
    assert int(feed.after(late, 0.0)[1][0]["index"]) == 0


def test_a_client_too_many_is_counted_and_sent_away(server, monkeypatch):
    monkeypatch.setattr("vfplan.live.server.MAX_CLIENTS", 1)
    client, coming = connected(server)
    next(coming)
    other, told = connected(server)
    with pytest.raises(ConnectionError):
        next(told)
    assert server.refused == 1
    client.close()
    other.close()


@needs_mcap
def test_mcap_holds_every_tick_to_the_bit(tmp_path):
    path, ticks = tmp_path / "a.mcap", made(5000)
    with McapWriter(path) as writer:
        for k in range(0, 5000, 11):
            writer.write(ticks[k : k + 11], 1.7e9 + k)
    assert read_ticks(path).tobytes() == ticks.tobytes()
    data = path.read_bytes()
    for damaged in (data[:40], b"", data[:200] + b"\xff" + data[201:]):
        path.write_bytes(damaged)
        with refuses(SessionError, "mcap-broken"):
            read_ticks(path)
    # What was cut off is read as far as it is whole.
    assert open_session(file_with(tmp_path / "a.mcap.part", data[:-40])).notes["cut"]
    half = data[: len(data) // 2]
    for cut, fewest in ((data[:-40], 5000), (half, 1500), (data + bytes(9999), 5000)):
        path.write_bytes(cut)
        found = read_ticks(path)
        assert found.tobytes() == ticks[: len(found)].tobytes()
        assert len(found) >= fewest


@needs_mcap
@pytest.mark.parametrize("start_s", [-2.0, -0.5, 1e11])
def test_times_that_mcap_cannot_hold_are_stamped_from_0(start_s, tmp_path):
    path, ticks = tmp_path / "a.mcap", made(1000)
    ticks["t"] += start_s
    with McapWriter(path) as writer:
        writer.write(ticks, float(ticks["t"][-1]))
    with path.open("rb") as stream:
        ((read, stamps_s),) = mcapfile.blocks(stream)
    assert read.tobytes() == ticks.tobytes()
    assert stamps_s == pytest.approx(made(1000)["t"], abs=1e-4)


@pytest.fixture
def short_of_room(monkeypatch):
    """Files may not grow beyond 80 kB."""
    monkeypatch.setattr(mcapfile, "CHUNK_BYTES", 2**13)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (80_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@needs_mcap
def test_a_full_disk_ends_the_recording_and_keeps_what_was_written(short_of_room, tmp_path):
    ticks = made(3000)
    ticks["force"] = np.random.default_rng(1).normal(size=(3000, 3))  # hard to compress
    ticks["hip"] = ticks["force"][::-1]
    with McapWriter(tmp_path / "a.mcap") as writer:
        for part in ticks.reshape(-1, 10):
            writer.write(part, 1.7e9)
    assert writer.full.errno == errno.EFBIG
    assert 100 < writer.kept < 3000
    assert read_ticks(tmp_path / "a.mcap").tobytes() == ticks[: writer.kept].tobytes()
    fixture = bundles.stored(tmp_path / "f.h5", bundles.whole())
    parts = iter([(part, {}) for part in ticks.reshape(-1, 10)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources, "stream_udp", lambda address: parts)
        words = ["live", str(fixture), "udp://127.0.0.1:5", "--mcap", str(tmp_path / "b.mcap")]
        run = CliRunner().invoke(cli, words)
    kept = len(read_ticks(tmp_path / "b.mcap"))
    line = f"{tmp_path}/b.mcap: File too large; it holds the first {kept} ticks"
    assert (run.exit_code, run.stderr) == (2, f"vfplan: failed: {line}\n")
    assert next(parts, None) is not None, "it ended when nothing was left to do"


def shown_messages(path):
    """Topic -> [(time [ns], message)], decoded by the definitions that the file holds."""
    pb2 = pytest.importorskip("google.protobuf.descriptor_pb2", reason="needs protobuf")
    from google.protobuf import descriptor_pool, message_factory
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    found, ros = {}, get_typestore(Stores.EMPTY)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema.encoding == "ros2msg":
                if schema.name not in ros.fielddefs:
                    ros.register(get_types_from_msg(schema.data.decode(), schema.name))
                row = (message.log_time, ros.deserialize_cdr(message.data, schema.name))
            else:
                pool = descriptor_pool.DescriptorPool()
                for one in pb2.FileDescriptorSet.FromString(schema.data).file:
                    pool.Add(one)
                kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
                row = (message.log_time, kind.FromString(message.data))
            found.setdefault(channel.topic, []).append(row)
    return found


@needs_mcap
@pytest.mark.parametrize("made", [bundles.whole, bundles.sheet])
def test_foxglove_and_rerun_see_the_ticks(made, tmp_path):
    path, ticks, fixture = tmp_path / "a.mcap", np.zeros(30, TICK), made()
    ticks["t"], ticks["state"] = np.arange(30) / 1000, 1
    ticks["hip"][:, 2], ticks["force"] = 1e-4 * np.arange(30), [-3, 0, 4]
    with McapWriter(path, (fixture, 100.0)) as writer:
        writer.write(ticks, 1.7e9)
    assert read_ticks(path).tobytes() == ticks.tobytes()
    found = shown_messages(path)
    times, numbers = zip(*found["/vfplan/numbers"], strict=True)
    assert np.ptp(times) == pytest.approx(29e6, abs=1000)
    assert times[-1] == pytest.approx(1.7e18, abs=1000)
    assert (numbers[5].force_n, numbers[5].state) == (5, 1)
    assert numbers[5].speed_mm_s == pytest.approx(100)
    scenes = [scene.entities[0] for _, scene in found["/vfplan/scene"]]
    assert len(scenes) == len(found["/vfplan/transforms"]) == 3
    q = scenes[0].arrows[0].pose.orientation
    along = 1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y)
    np.testing.assert_allclose(along, [-0.6, 0, 0.8], atol=1e-12)
    shape = found["/vfplan/fixture"][0][1].entities[0]
    if fixture.mesh is None:
        points = [[p.x, p.y, p.z] for line in shape.lines for p in line.points]
        assert np.array_equal(points, fixture.points)
    else:
        assert np.array_equal(shape.triangles[0].indices, fixture.mesh.ravel())
    layout = json.loads((ROOT / "samples/foxglove/layout.json").read_text())["configById"]
    plots = [path["value"] for panel in layout.values() for path in panel.get("paths", ())]
    shown = layout["3D!vfplan"]["topics"]
    assert {*shown, *(path.split(".")[0] for path in plots)} <= {*found}
    assert all(hasattr(numbers[0], path.split(".")[1]) for path in plots)
    assert all(topic["visible"] for topic in shown.values()), "a bare cloud has points alone"
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.exists():
        pytest.skip("Rerun's converter was not tried: needs rerun-sdk from PyPI")
    output(rerun, "mcap", "convert", path, "-o", tmp_path / "a.rrd")
    said = output(rerun, "rrd", "print", tmp_path / "a.rrd")
    parts = "Points3D:positions", "Transform3D:translation", "vfplan_msgs.msg.Numbers:message"
    assert all(part in said for part in parts)


@needs_mcap
def test_a_result_through_the_command(vfplan_cli, tmp_path):
    """Shown by the command, kept by it, and read back."""
    fixture, session = tmp_path / "f.h5", tmp_path / "s.csv"
    vfplan.write_fixture(bundles.whole(), fixture)
    hip = bundles.whole().points[0] + np.linspace([0, 0, 0.02], [0, 0, 0.001], 300)
    write_session(session, vfplan.Session(np.arange(300) / 1000, hip))
    result, kept = tmp_path / "r.h5", tmp_path / "k.mcap"
    assert vfplan_cli("replay", fixture, session, "-o", result).sound
    words = ("live", fixture, result, "--json")
    report = vfplan_cli(*words, "--mcap", kept, "--openigtlink", "0").sound.json
    assert (report["ticks"], report["verdict"]) == (300, "shown and recorded to the end")
    part = vfplan_cli(*words, "--web", "0", "--seconds", "0.05").json
    assert part["verdict"] == "shown for 0.05 s"
    ticks, wanted = read_ticks(kept), vfplan.read_result(result)[0]
    for name in ("hip", "proxy", "normal", "force", "state"):
        assert np.array_equal(ticks[name], getattr(wanted, name))
    assert vfplan_cli("replay", fixture, kept, "--mcap", tmp_path / "again.mcap").sound
    assert read_ticks(tmp_path / "again.mcap").tobytes() == ticks.tobytes()
    assert vfplan_cli("live", fixture, result).code == 2
    other = bundles.stored(tmp_path / "other.h5", bundles.small())
    vfplan_cli("live", other, result, "--web", "0", "--json").fails(3, error="fixture-differs")
    assert vfplan_cli("live", fixture, "udp://nowhere", "--mcap", tmp_path / "x.mcap").code == 2
    assert not (tmp_path / "x.mcap").exists()


@pytest.fixture(scope="module")
def reference_client(tmp_path_factory):
    """Debian's OpenIGTLink client, which checks every CRC."""
    need_header("openigtlink/igtlClientSocket.h", "libopenigtlink-dev", "/usr/include")
    program = tmp_path_factory.mktemp("client") / "client"
    flags = ("-std=c++17", "-I/usr/include/openigtlink", "-lOpenIGTLink", "-lpthread")
    output(need_program("g++", "g++"), NATIVE / "igtl_client.cpp", "-o", program, *flags)
    return program


@pytest.mark.slow
def test_the_reference_library_reads_it(server, feed, reference_client):
    """Every kind of message, to the last bit."""
    words = [reference_client, str(server.port), "42"]
    client = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    ticks = made(60_000)
    for k in itertools.count():
        if client.poll() is not None or 10 * k >= len(ticks):
            break
        feed.put(ticks[10 * k :][:10])
        time.sleep(0.01)
    lines = client.communicate(timeout=60)[0].splitlines()
    assert client.returncode == 0, lines
    fixture = bundles.whole()
    first = " ".join(f"{x:.9g}" for x in (igtl.TO_RAS * fixture.points[0]).astype(np.float32))
    assert lines[0].startswith(f"POLYDATA vfplan_cloud {len(fixture.points)} points {first}")
    assert f"{len(fixture.curve.closed)} lines" in lines[0]
    assert lines[1].startswith("POLYDATA vfplan_contact")
    forces = [line for line in lines if line.startswith("SENSOR vfplan_force")]
    known = {" ".join(f"{x:.17g}" for x in tick["force"] * [-1, -1, 1]) for tick in ticks}
    assert len(forces) == 10
    assert all(line.split(" ", 2)[2] in known for line in forces)
    assert [device for device, *_ in static_bodies(fixture)] == ["vfplan_cloud", "vfplan_contact"]


def placed(angle, place):
    """(4, 4) a pose that is turned about (1, 2, 2)."""
    return np.block([[turned([1, 2, 2], angle), np.reshape(place, (3, 1))], [0, 0, 0, 1]])


@pytest.fixture
def tracker(monkeypatch):
    """A server of the protocol's Python library, with a function that sends a transform."""
    pyigtl = pytest.importorskip("pyigtl", reason="needs pip install pyigtl")
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # which it would catch
    server = pyigtl.OpenIGTLinkServer(port=free_port(socket.SOCK_STREAM), local_server=True)

    def send(matrix, time_s, device="Body", status=None):
        sent = pyigtl.TransformMessage(matrix, time_s, device)
        sent.header_version, sent.metadata = 1 + bool(status), {"TransformStatus": status}
        while not server.is_connected():
            time.sleep(0.01)
        server.send_message(sent)

    yield server.port, send
    server.stop()


@pytest.mark.parametrize("is_ras", [False, True])
def test_a_trackers_poses_arrive_as_the_protocols_library_sends_them(is_ras, tracker):
    port, send = tracker
    frame = vfplan.MovingFrame()
    address, take = f"igtl://127.0.0.1:{port}/Body", lambda t, pose: frame.pose(t - 1e9, pose)
    receiver = igtl.PoseReceiver(address, is_ras=is_ras, take=take)
    send(placed(0.5, (10, -20, 30)), 1e9 + 0.25)
    send(placed(0.1, (0, 0, 0)), 1e9, "Probe")
    send(placed(0.6, (10, -20, 31)), 1e9 + 0.5, status="OK")
    send(placed(0.6, (10, -20, 31)), 1e9 + 0.6, status="INVALID")
    send(np.diag([2, 2, 2, 1.0]), 1e9 + 0.75)
    while receiver.left_out.total() < 2:
        time.sleep(0.01)
    receiver.close()
    assert [time_s - 1e9 for time_s, *_ in receiver.poses] == pytest.approx([0.25, 0.5], abs=1e-6)
    signs = np.diag([-1, -1, 1, 1] if is_ras else [1, 1, 1, 1])
    true = signs @ [placed(0.5, (0.01, -0.02, 0.03)), placed(0.6, (0.01, -0.02, 0.031))] @ signs
    np.testing.assert_allclose([pose for *_, pose in receiver.poses], true, atol=1e-6)
    assert (len(receiver.left_out), receiver.other_devices) == (2, {"Probe"})
    np.testing.assert_allclose(frame.at(0.3), true[0], atol=1e-6)


def test_a_damaged_transform_is_none():
    body = igtl.transform("Body", 1.5, np.ones(3))[58:]
    for code, data, whole in (("damaged", body[:-1] + b"!", body), ("size", body[4:], body[4:]),
                              ("not-rigid", bytes(48), bytes(48))):  # fmt: skip
        with refuses(InputError, f"transform-{code}"):
            igtl.decode_transform(data, 1, igtl.crc64(whole))
    with refuses(InputError, "address-unusable"):
        igtl.PoseReceiver(f"igtl://127.0.0.1:{free_port(socket.SOCK_STREAM)}/Body")


def test_poses_go_on_after_a_volume_after_what_is_no_message_and_after_a_break():
    volume = igtl.HEADER.pack(1, b"IMAGE", b"Volume", 0, 2**26 + 5, 0) + bytes(2**26 + 5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        receiver = igtl.PoseReceiver(f"igtl://127.0.0.1:{server.getsockname()[1]}/Body")
        for k, end in enumerate((volume, b"GET / HTTP/1.1\r\n" * 10, b"")):
            with server.accept()[0] as client:
                for more in (end, b""):
                    with suppress(OSError):
                        client.sendall(igtl.transform("Body", time.time(), np.full(3, k)) + more)
                while len(receiver.poses) < (2, 3, 5)[k]:
                    time.sleep(0.01)
    receiver.close()
    assert [pose[0, 3] * 1e3 for *_, pose in receiver.poses] == pytest.approx([0, 0, 1, 2, 2])
    assert receiver.reconnected >= 2
    assert "was made again" in pose_warnings(receiver)[-1]


@needs_mcap
def test_recorded_poses_move_the_fixture_of_the_replay(tracker, tmp_path, monkeypatch):
    """On the loop's clock, which the ticks carry; the replay takes the file.

    That no pose comes any more is told once, and by the status of each tick.
    """
    port, send = tracker
    fixture, poses, recorded = (tmp_path / name for name in ("f.h5", "p.csv", "r.mcap"))
    vfplan.write_fixture(bundles.small(), fixture)

    def ticks(address):
        begun = time.time()
        for k in range(7):
            if k < 5:
                send(placed(k, (k, 0, 0)), time.time())
            else:
                time.sleep(0.3)
            part = made(100)
            part["t"] = time.time() - begun + 7 + np.arange(-99, 1) / 1e4
            yield part, {}
            time.sleep(0.05)

    def shown(client, ticks):
        told.append(client.silent)
        return put(client, ticks)

    told, put = [], PositionStream.put
    monkeypatch.setattr(PositionStream, "put", shown)
    monkeypatch.setattr("vfplan.live.command.SILENT_TOLD_S", 0.2)
    monkeypatch.setattr(sources, "stream_udp", ticks)
    words = ["live", fixture, "udp://127.0.0.1:5", "--mcap", recorded, "--poses-out", poses,
             "--poses-from", f"igtl://127.0.0.1:{port}/Body", "--json"]  # fmt: skip
    run = CliRunner().invoke(cli, [*map(str, words)])
    report = json.loads(run.stdout)
    assert report["poses"] == 5
    assert "no pose came for 0.2 s or longer" in report["warnings"]
    assert run.stderr.count("no pose has come for 0.2 s") == 1
    assert told == [""] * 6 + ["no pose has come for 0.2 s"]
    status = igtl.tick_messages(np.zeros(1, sources.SHOWN)[0], told[-1])[-150:]
    assert told[-1].encode() in status
    assert struct.pack(">H", igtl.WARNING) in status
    got = read_poses(poses)
    assert (got.time[0], (got.arrived - got.time).max()) == pytest.approx((7, 0), abs=0.2)
    true = [placed(k, (k / 1e3, 0, 0)) for k in range(5)]
    np.testing.assert_allclose(matrices(got.pose), true, atol=1e-6)
    words = ["replay", fixture, recorded, "--poses", poses, "--rule", "robust", "--json"]
    assert json.loads(CliRunner().invoke(cli, [*map(str, words)]).stdout)["poses_refused"] == 0
