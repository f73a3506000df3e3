"""Ways to alter a file and make its digests right again, as somebody who wants in would.

So the checks behind the digests are reached. As in `altering`, each takes (rng, file, other).
"""

import hashlib
import io
import json
import struct
import zipfile

import numpy as np

from lanewise.runs import records
from lanewise.system import safe_io

HOSTILE = (
    *(None, True, -1, 10**30, 1e308, -0.5, "", "x", "../../etc/passwd", "/dev/zero", "\x1b[2J\x07"),
    *("\u202egnp", "a\nb", [], [[]], {}, {"a": 1}, [1, "x"], "9" * 5000, 2**63, -(2**63)),
)
"""Values that no field of ours has."""


def hostile(rng):
    """A value that no field of ours has."""
    return HOSTILE[rng.integers(len(HOSTILE))]


def sign(path, manifest, field):
    """Write a manifest with a digest that is right."""
    manifest[field] = safe_io.digest(manifest, field)
    path.write_text(json.dumps(manifest))


def signed_field(rng, file, other):
    """A field of a document with a digest: gone, hostile, or one more."""
    field = "manifest_sha256" if b"manifest_sha256" in file.read_bytes() else "digest"
    manifest = json.loads(file.read_text())
    names = [name for name in manifest if name not in UNREAD]
    name = names[rng.integers(len(names))]
    match rng.integers(3):
        case 0:
            del manifest[name]
        case 1:
            manifest[name] = hostile(rng)
        case _:
            inside = manifest[name] if isinstance(manifest[name], dict) else manifest
            keys = [key for key in inside if key not in UNREAD]
            inside[keys[rng.integers(len(keys))] if keys else "x"] = hostile(rng)
    if name == field:
        file.write_text(json.dumps(manifest))
    else:
        sign(file, manifest, field)


UNREAD = ("created", "lanewise")
"""Fields of a manifest that nothing depends on."""


def signed_books(rng, file, other):
    """What a checkpoint remembers of its stage, its counts and its metrics."""
    manifest = json.loads(file.read_text())
    meta = manifest["meta"]
    book = meta["ledger"] if "ledger" in meta and rng.integers(2) else meta
    if "ledger" not in meta or (book is meta and "stage" not in meta):
        return signed_field(rng, file, other)
    names = list(book)
    name = names[rng.integers(len(names))]
    if rng.integers(4) == 0:
        del book[name]
    else:
        choice = [hostile(rng), 1 + meta["ledger"]["chunks"], [float(i) for i in range(99)]]
        book[name] = choice[rng.integers(3)]
    return sign(file, manifest, "manifest_sha256")


def parsed(data):
    """(header, body) of a safetensors file."""
    (length,) = struct.unpack_from("<Q", data)
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def packed(header, body, length=None):
    """A safetensors file."""
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + body


def signed_arrays(rng, file, other):
    """A safetensors file that lies, in its header or in its values."""
    header, body = parsed(file.read_bytes())
    names = [name for name in header if name != "__metadata__"]
    name = names[rng.integers(len(names))]
    entry, length = header[name], None
    match rng.integers(9):
        case 0:
            length = [0, 1, 2**31, 2**63, 2**64 - 1][rng.integers(5)]
        case 1:
            entry["shape"] = [[0], [2**40], [2**62, 4], [], [1, 1, 1, 7]][rng.integers(5)]
        case 2:
            kinds = ["F64", "BF16", "U8", "F8_E4M3", "OBJECT", "I128"]
            entry["dtype"] = kinds[rng.integers(len(kinds))]
        case 3:
            begin, end = entry["data_offsets"]
            entry["data_offsets"] = [
                [0, end],
                [begin, end + 8],
                [end, begin],
                [begin, 2**62],
                [-8, end],
            ][rng.integers(5)]
        case 4:
            header[["../../x", "x" * 300, "\x1b[2J", "a/b"][rng.integers(4)]] = header.pop(name)
        case 5:
            body = body[: int(rng.integers(0, len(body)))]
        case 6:
            body += rng.bytes(int(rng.integers(1, 100)))
        case _:
            body = with_bad_value(rng, header, body)
    _store_signed(file, packed(header, body, length), rng)


def with_bad_value(rng, header, body):
    """A float that is not finite, or a truth value that is neither."""
    kinds = [n for n, e in header.items() if n != "__metadata__" and e["dtype"] in ("F32", "BOOL")]
    entry = header[kinds[rng.integers(len(kinds))]]
    begin, end = entry["data_offsets"]
    size = 4 if entry["dtype"] == "F32" else 1
    bad = [np.float32(v).tobytes() for v in (np.nan, np.inf, -np.inf)] if size == 4 else [b"\x07"]
    place = begin + size * int(rng.integers(max(1, (end - begin) // size)))
    return body[:place] + bad[rng.integers(len(bad))] + body[place + size :]


def _store_signed(file, data, rng):
    """The file, and its manifest with the digests and sometimes the arrays made to agree."""
    file.write_bytes(data)
    path = file.with_suffix(".json")
    manifest = json.loads(path.read_text())
    manifest |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    if rng.integers(2):
        try:
            header, _ = parsed(data)
            names = {"F32": "float32", "I32": "int32", "U32": "uint32", "BOOL": "bool"}
            manifest["arrays"] = {
                name: [names.get(entry["dtype"], entry["dtype"]), *entry["shape"]]
                for name, entry in header.items()
            }
        except (ValueError, struct.error):
            pass
    sign(path, manifest, "manifest_sha256")


def signed_settings(rng, file, other):
    """Other settings under the digests of all that belongs to them."""
    lines = file.read_text().splitlines()
    places = [n for n, line in enumerate(lines) if " = " in line]
    place = places[rng.integers(len(places))]
    name = lines[place].split(" = ")[0]
    values = ["nan", "-inf", "true", '"x"', "[]", "[[1]]", "1e400", "9" * 5000, "{a=1}", "-1e9"]
    lines[place] = f"{name} = {values[rng.integers(len(values))]}"
    text = "\n".join(lines) + "\n"
    file.write_text(text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    for path in file.parent.rglob("*.json"):
        manifest = json.loads(path.read_text())
        if "settings_digest" in manifest:
            manifest["settings_digest"] = digest
            sign(path, manifest, "manifest_sha256" if "meta" in manifest else "digest")


def policy_member(rng, file, other):
    """A policy with one array that lies, in an archive that is whole."""
    with zipfile.ZipFile(file) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = [name for name in members if name != "about.npy"]
    name, method = names[rng.integers(len(names))], zipfile.ZIP_STORED
    data = members[name]
    end = 10 + int.from_bytes(data[8:10], "little")
    match rng.integers(8):
        case 0:
            members[name] = _header(rng.choice(SHAPES), "<f4") + data[end:]
        case 1:
            kinds = ["|O", "<f8", ">f4", "<M8[s]", "|V4", "<U9999999", "<c8"]
            members[name] = _header("(26, 16)", kinds[rng.integers(len(kinds))]) + data[end:]
        case 2:
            members[name] = data[:end] + data[end : end + int(rng.integers(0, len(data) - end))]
        case 3:
            bad = np.float32([np.nan, np.inf, -np.inf][rng.integers(3)]).tobytes()
            members[name] = data[: end + 4] + bad + data[end + 8 :]
        case 4:
            method = zipfile.ZIP_DEFLATED
            members[name] = b"\0" * 30_000_000 if rng.integers(2) else data
        case 5:
            del members[name]
        case 6:
            members[["../../x.npy", "a\\b.npy", "/etc/x.npy"][rng.integers(3)]] = data
        case _:
            literal = b"\x93NUMPY\x01\x00" + struct.pack("<H", 200) + b"(" * 199 + b"\n"
            members[name] = literal + data[end:]
    _store_zip(file, members, method)


SHAPES = ("(26, 99999999)", "(4294967296,)", "(0,)", "()", "(-1,)", "(26, 16, 1)", "(1e9,)")


def _header(shape, kind):
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    text += " " * (63 - (10 + len(text)) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def _store_zip(file, members, method=zipfile.ZIP_STORED):
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)


NEEDED = (
    *("format", "version", "memory", "levels", "goals", "decision_frequency", "seed", "controller"),
    *("lowest_speed", "highest_speed", "speed_step", "moves", "lifetime", "reference", "planner"),
    *("acceleration", "ticks", "lateral_tolerance", "settings_digest", "decision"),
)


def policy_about(rng, file, other):
    """What a policy says of itself: a field it needs is gone or hostile."""
    with np.load(file, allow_pickle=False) as stored:
        arrays = dict(stored)
    about = json.loads(str(arrays.pop("about")))
    tables = [about, about["goals"], *([about["planner"]] if "planner" in about else [])]
    places = [(table, name) for table in tables for name in table if name in NEEDED]
    table, name = places[rng.integers(len(places))]
    if rng.integers(4):
        bad = [v for v in HOSTILE if not (isinstance(v, str) and isinstance(table[name], str))]
        table[name] = [*bad, float("nan"), float("inf")][rng.integers(len(bad) + 2)]
        if table[name] in (True, -0.5, -1, []) and name != "moves":
            table[name] = None
    else:
        del table[name]
    content = io.BytesIO()
    np.savez(content, about=np.asarray(json.dumps(about)), **arrays)
    file.write_bytes(content.getvalue())


def many_members(rng, file, other):
    """An archive of very many, or of overlapping, members."""
    _store_zip(file, {f"{number}.npy": b"" for number in range(int(rng.integers(600, 4000)))})


def signed_table(rng, file, other):
    """A test's episodes: one cell hostile or another, under the digest of the whole."""
    rows = [line.split(",") for line in file.read_text().splitlines()]
    row = int(rng.integers(0, len(rows)))
    column = int(rng.integers(0, len(rows[0])))
    words = ["nan", "inf", "1e400", "x", "9" * 40, '"', "-7", "", "\0", "a" * 200_000]
    word = words[rng.integers(len(words))]
    if rows[row][column] == word:
        word = "x"
    rows[row][column] = word
    text = "\n".join(",".join(cells) for cells in rows) + "\n"
    file.write_bytes(text.encode())
    path = file.with_suffix(".json")
    stored = json.loads(path.read_text())
    stored["episodes_sha256"] = hashlib.sha256(text.encode()).hexdigest()
    sign(path, stored, "digest")


def signed_line(rng, file, other):
    """A line of a journal that is no result, under digests that are right."""
    head, *lines = file.read_text().splitlines()
    records = [json.loads(line) for line in lines]
    record = records[rng.integers(len(records))]
    names = [name for name in record if name != "digest"]
    name = names[rng.integers(len(names))]
    if rng.integers(4):
        record[name] = [v for v in HOSTILE if type(v) is not type(record[name])][rng.integers(8)]
    else:
        del record[name]
    before, text = safe_io.digest(json.loads(head)), [head]
    for each in records:
        chained = hashlib.sha256((before + safe_io.digest(each)).encode()).hexdigest()[:16]
        before = each["digest"] = chained
        text.append(json.dumps(each))
    file.write_text("\n".join(text) + "\n")


def signed_metrics(rng, file, other):
    """A line of the metrics that is no record, under the digests of all who know the file."""
    lines = file.read_text().splitlines()
    place = int(rng.integers(len(lines)))
    record = json.loads(lines[place])
    names = list(record)
    name = names[rng.integers(len(names))]
    match rng.integers(3):
        case 0:
            if name.startswith(records.OPTIONAL):
                name = "kind"
            del record[name]
        case 1:
            record[name] = [[], {}, [1], "9" * 30_000][rng.integers(4)]
        case _:
            record["x" * int(rng.integers(1, 90))] = 1
    lines[place] = json.dumps(record)
    text = "\n".join(lines) + "\n"
    file.write_text(text)
    for path in file.parent.rglob("*.json"):
        manifest = json.loads(path.read_text())
        if "metrics_bytes" in manifest.get("meta", {}):
            digest = hashlib.sha256(text.encode()).hexdigest()
            manifest["meta"] |= {"metrics_bytes": len(text.encode()), "metrics_sha256": digest}
            sign(path, manifest, "manifest_sha256")
