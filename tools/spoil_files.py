#!/usr/bin/env python3
"""Spoils files at random and sends them through `info`, `convert` and `simplify`.

    tools/spoil_files.py STONECUT N SEED FILE[=INPUT]...

Every FILE is spoiled N times. With `=INPUT` the command reads INPUT, which names FILE (a library, an image) and lies in the same
folder. Each run has 512 MiB of addresses, 20 s and one thread; a panic, a signal, an exit code beyond 6, a run that is stopped, or a
peak beyond 64 MiB and 100 times the file is a fault: its file is kept in the working folder and named. Work happens in /dev/shm.
Prints, for each FILE, how many were read and refused, the largest peak and the longest processor time.
"""

import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import zipfile

ADDRESSES, SECONDS = 512 << 20, 20
NASTY = [b"0", b"-1", b"1", b"2", b"255", b"256", b"65536", b"2147483647", b"-2147483648", b"4294967295", b"4294967296", b"1e39",
         b"9223372036854775807", b"18446744073709551615", b"-1e308", b"1e-320", b"1e400", b"nan", b"-nan(ind)", b"1.#QNAN", b"inf",
         b"0.5", b'""', b"1/2/3", b"-1/-1", b"1//"]
WORDS = [0, 0xffffffff, 0x7fc00000, 0x7f800000, 0x80000000, 0x7f7fffff, 1, 0xffff, 0x10000]


def spoil_bytes(data, rng, begin=0):
    """Flips bits, writes extreme values, cuts off or repeats a piece; more often near the beginning."""
    data = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 5])):
        if len(data) <= begin:
            break
        end = min(len(data), begin + 400) if rng.random() < 0.5 else len(data)
        at, kind = rng.randrange(begin, end), rng.randrange(9)
        if kind == 0:
            del data[at:]
        elif kind == 1:
            del data[at:at + rng.randrange(40)]
        elif kind == 2:
            data[at:at] = data[at:at + 64]
        elif kind <= 5:
            word = rng.choice(WORDS).to_bytes(4, "little")
            data[at:at + 4] = word[:len(data) - at]
        else:
            data[at] ^= 1 << rng.randrange(8)
    return bytes(data)


def spoil_text(data, rng):
    """Replaces a word, repeats, drops or swaps lines, or cuts the text off."""
    lines = data.splitlines(keepends=True)
    for _ in range(rng.choice([1, 1, 2, 4])):
        if not lines:
            break
        i, j, kind = rng.randrange(len(lines)), rng.randrange(len(lines)), rng.randrange(10)
        words = lines[i].split()
        if kind == 0:
            del lines[i]
        elif kind == 1:
            lines.insert(i, lines[j])
        elif kind == 2:
            lines[i], lines[j] = lines[j], lines[i]
        elif kind == 3:
            del lines[i + 1:]
        elif kind == 4:
            lines[i] = lines[i][:rng.randrange(len(lines[i]))]
        elif kind == 5:
            lines[i] = lines[i].rstrip() + b" " + b" ".join(words[1:]) * rng.randint(1, 40) + b"\n"
        elif words:
            words[rng.randrange(len(words))] = rng.choice(NASTY)
            lines[i] = b" ".join(words) + b"\n"
    return b"".join(lines)


def spoil_json(data, rng):
    """Replaces numbers and words of a glTF document by others of it, or nasty ones."""
    import re
    pieces = re.split(rb"([-+.0-9eE]{1,24}|\"[^\"]*\")", data)
    for _ in range(rng.choice([1, 1, 2, 4])):
        at = rng.randrange(len(pieces))
        if not pieces[at]:
            continue
        kind = rng.randrange(4)
        if pieces[at][:1].isdigit() and kind:
            pieces[at] = rng.choice(NASTY[:21])
        else:
            pieces[at] = rng.choice(pieces)
    return b"".join(pieces)


def spoil_glb(data, rng):
    length = int.from_bytes(data[12:16], "little")
    json, rest = data[20:20 + length], data[20 + length:]
    kind = rng.randrange(8)
    if kind == 0:
        return spoil_bytes(data, rng)
    if kind <= 3:
        rest = rest[:8] + spoil_bytes(rest[8:], rng)
    else:
        json = spoil_json(json, rng)
        json += b" " * (-len(json) % 4)
    return (data[:8] + (20 + len(json) + len(rest)).to_bytes(4, "little") + len(json).to_bytes(4, "little") + b"JSON" + json + rest)


def spoil_zip(data, rng, folder):
    """The archive's bytes, or its first file spoiled and packed again."""
    if rng.random() < 0.6:
        return spoil_bytes(data, rng, rng.choice([0, max(0, len(data) - 200)]))
    path = os.path.join(folder, "in.zip")
    with open(path, "wb") as file:
        file.write(data)
    with zipfile.ZipFile(path) as archive:
        name = archive.namelist()[0]
        content = spoil_text(archive.read(name), rng)
    with zipfile.ZipFile(path, "w", rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])) as archive:
        for _ in range(rng.choice([1, 1, 1, 2])):
            archive.writestr(rng.choice([name, "../" + name, "/" + name, "a/b.ply", name.upper()]), content)
    with open(path, "rb") as file:
        return file.read()


def spoiled(name, data, rng, folder):
    kind = name.rsplit(".", 1)[1].lower()
    if kind == "glb":
        return spoil_glb(data, rng)
    if kind == "gltf":
        return spoil_json(data, rng)
    if kind == "zip":
        return spoil_zip(data, rng, folder)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") and rng.random() < 0.6:
        return spoil_text(data.decode("utf-16").encode(), rng).decode("utf-8", "replace").encode("utf-16")
    is_text = b"\0" not in data[:1000]
    return spoil_text(data, rng) if is_text else spoil_bytes(data, rng)


def run(words, folder):
    """Exit code (negative: a signal), peak in KiB, processor seconds, and what was said."""
    said = os.path.join(folder, "said")
    pid = os.posix_spawn(words[0], words, os.environ, file_actions=[
        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0), (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
        (os.POSIX_SPAWN_OPEN, 2, said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)], setsigdef=[signal.SIGALRM])
    signal.signal(signal.SIGALRM, lambda *_: os.kill(pid, signal.SIGKILL))
    signal.alarm(SECONDS)
    _, status, usage = os.wait4(pid, 0)
    signal.alarm(0)
    with open(said, "rb") as file:
        return os.waitstatus_to_exitcode(status), usage.ru_maxrss, usage.ru_utime + usage.ru_stime, file.read()


def main():
    stonecut, n, seed = os.path.abspath(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    n_faults = 0
    print("| file | bytes | read | refused | largest peak, MiB | longest run, s of processor |\n|---|---|---|---|---|---|")
    for argument in sys.argv[4:]:
        path, _, through = argument.partition("=")
        name, rng = os.path.basename(path), random.Random(f"{seed} {path}")
        sound = open(path, "rb").read()
        with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
            for other in os.listdir(os.path.dirname(path) or "."):
                if through and os.path.isfile(os.path.join(os.path.dirname(path), other)):
                    shutil.copy(os.path.join(os.path.dirname(path), other), folder)
            at, source = os.path.join(folder, name), os.path.join(folder, through or name)
            read = refused = peak = longest = 0
            for _ in range(n):
                data = spoiled(name, sound, rng, folder)
                with open(at, "wb") as file:
                    file.write(data)
                out = os.path.join(folder, "out." + rng.choice(["ply", "obj", "stl", "glb"]))
                skip = rng.choice([[], ["--skip-bad"]])
                bake = ["--texture", "bake", "--bake-size", "64"] if through or b"KHR_texture" in data else []
                last = 0
                for words in (["info", "--check", source], ["convert", source, out, "--force", "-q"] + skip,
                              ["simplify", source, out, "--triangles", "60", "--force", "--restart", "-q", "--threads", "1"] + skip + bake):
                    if words[0] == "simplify" and last == 4 and rng.random() < 0.75:
                        break  # The reader has refused the file twice.
                    last, kib, seconds, said = run([stonecut] + words, folder)
                    peak, longest = max(peak, kib), max(longest, seconds)
                    if last not in (0, 2, 3, 4, 5, 6) or b"panicked" in said or kib > (64 << 10) + len(data) * 100 // 1024:
                        n_faults += 1
                        kept = f"fault-{n_faults}-{seed}-{name}"
                        with open(kept, "wb") as file:
                            file.write(data)
                        print(f"FAULT {last} {kib} KiB {seconds:.1f} s: {' '.join(words)}: {kept}\n{said[:600].decode(errors='replace')}",
                              flush=True)
                read, refused = read + (last in (0, 3)), refused + (last not in (0, 3))
        print(f"| {name} | {len(sound)} | {read} | {refused} | {peak / 1024:.0f} | {longest:.2f} |", flush=True)
    sys.exit(n_faults > 0)


if __name__ == "__main__":
    main()
