"""Machine code on disk: never that of another version, never in the way, never a reason to fail.

Most tests drive a package of two kernels, `tiny`, whose ``_jit.py`` and what it imports are the real ones: its `answer`
calls a kernel of another file, which is what an upgrade changes behind Numba's back.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import importlib.util
import os
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numba
import pytest

from curvescan import _jit, _kernel_cache

pytestmark = pytest.mark.slow

SOURCE = Path(_jit.__file__).parent
CALLER = """from tiny._jit import kernel
from tiny.callee import part


@kernel
def answer(x):
    return 2.0 * part(x)
"""
CALLEE = """from tiny._jit import kernel


@kernel
def part(x):
    return x + {number}
"""
N_COMPILED = "sum(sum(k.stats.cache_misses.values()) for k in _jit._kernels if hasattr(k, 'stats'))"
"""How many variants of kernels a process had to compile; 0 with NUMBA_DISABLE_JIT=1."""

ASK = f"""import sys
from tiny import _jit
from tiny.caller import answer
print(answer(1.0), {N_COMPILED})
"""


def write_tiny(parent, number):
    folder = parent / "tiny"
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("_jit.py", "_kernel_cache.py", "_compilation.py"):
        text = (SOURCE / name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace("curvescan.", "tiny."), encoding="utf-8")
    (folder / "__init__.py").write_text("")
    (folder / "caller.py").write_text(CALLER)
    (folder / "callee.py").write_text(CALLEE.format(number=number))
    return folder


def environment(path, **changes):
    """Environment of a child process that finds `path` and no cache folder of this process."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "XDG_CACHE", "PYTHON"))}
    env["PYTHONPATH"] = str(path)
    return env | {k: str(v) for k, v in changes.items()}


def ask(env, code=ASK, python=sys.executable):
    """Run `code`; return `answer(1.0)`, how many kernels it had to compile, and what was said."""
    done = subprocess.run([python, "-c", code], env=env, capture_output=True, text=True, check=True, timeout=300)
    value, n_compiled = done.stdout.split()
    # what a slow machine says of the time that kernels took is another test's matter
    said = [line for line in done.stderr.splitlines() if "its kernels" not in line]
    return float(value), int(n_compiled), "".join(line + "\n" for line in said)


def cache_folders(parent):
    return {path.name for path in parent.glob("tiny-kernels-*")}


def kernel_modules():
    """Names of the modules of the package that define kernels."""
    names = [
        ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts)
        for path in SOURCE.rglob("*.py")
        if "from curvescan._jit import kernel" in path.read_text(encoding="utf-8")
    ]
    assert len(names) > 20
    return names


def wheel(folder, version, number):
    """A wheel of `tiny`, written by hand: no build backend, no network."""
    sources = write_tiny(folder / version, number)
    info = f"tiny-{version}.dist-info"
    files = {f"tiny/{path.name}": path.read_bytes() for path in sorted(sources.glob("*.py"))}
    files[f"{info}/METADATA"] = f"Metadata-Version: 2.1\nName: tiny\nVersion: {version}\n".encode()
    files[f"{info}/WHEEL"] = b"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    rows = [
        f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode().rstrip('=')},{len(data)}"
        for name, data in files.items()
    ]
    files[f"{info}/RECORD"] = "\n".join([*rows, f"{info}/RECORD,,", ""]).encode()
    path = folder / f"tiny-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            # one time stamp for all versions, as reproducible builds have it
            archive.writestr(zipfile.ZipInfo(name, (2020, 2, 2, 0, 0, 0)), data)
    return path


@pytest.fixture
def tiny(tmp_path):
    """Environment of a process that finds version 1 of `tiny`; its caches lie in tmp_path."""
    write_tiny(tmp_path / "site", 1.0)
    return environment(tmp_path / "site", XDG_CACHE_HOME=tmp_path / "user")


@pytest.mark.parametrize("named", [True, False], ids=["NUMBA_CACHE_DIR", "beside the package"])
def test_an_upgraded_wheel_runs_no_machine_code_of_the_old_one(tmp_path, named):
    if importlib.util.find_spec("pip") is None:
        pytest.skip("needs pip")
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True, timeout=300)
    python = venv / ("Scripts" if os.name == "nt" else "bin") / "python"
    where = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(subprocess.check_output([python, "-c", where], text=True).strip())
    # Numba comes from the environment of this test
    (site / "borrowed.pth").write_text(str(Path(numba.__file__).parent.parent))
    folder = tmp_path / "kernels" if named else site / "tiny" / "__pycache__"
    env = environment("", XDG_CACHE_HOME=tmp_path / "user")
    if named:
        env["NUMBA_CACHE_DIR"] = str(folder)

    def upgrade(version, number):
        install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-index"]
        options = ["--no-deps", "--quiet", "--disable-pip-version-check", "--upgrade"]
        path = wheel(tmp_path, version, number)
        subprocess.run([*install, *options, str(path)], env=env, check=True, timeout=300)

    upgrade("1.0", 1.0)
    assert ask(env, python=python)[:2] == (4.0, 2)
    assert ask(env, python=python)[:2] == (4.0, 0)
    old = cache_folders(folder)
    upgrade("2.0", 20.0)
    assert ask(env, python=python)[:2] == (42.0, 2)
    assert ask(env, python=python)[:2] == (42.0, 0)
    assert len(cache_folders(folder) - old) == 1


def test_two_versions_in_one_folder_keep_their_own_answers(tmp_path, tiny):
    write_tiny(tmp_path / "other", 20.0)
    tiny["NUMBA_CACHE_DIR"] = str(tmp_path / "kernels")
    other = tiny | {"PYTHONPATH": str(tmp_path / "other")}
    assert [ask(env)[:2] for env in (tiny, other, tiny, other)] == [(4.0, 2), (42.0, 2), (4.0, 0), (42.0, 0)]
    assert len(cache_folders(tmp_path / "kernels")) == 2


def test_several_processes_that_start_at_once_all_answer(tmp_path, tiny):
    processes = [
        subprocess.Popen([sys.executable, "-c", ASK], env=tiny, stdout=subprocess.PIPE, text=True) for _ in range(3)
    ]
    assert [float(p.communicate(timeout=300)[0].split()[0]) for p in processes] == [4.0] * 3
    assert ask(tiny)[:2] == (4.0, 0)


def test_an_installation_that_cannot_be_written_uses_the_users_cache(tmp_path, tiny):
    # a file where a folder should be: refused to root as well
    (tmp_path / "site" / "tiny" / "__pycache__").write_text("")
    tiny["NUMBA_CACHE_DIR"] = str(tmp_path / "site" / "tiny" / "__init__.py")
    assert ask(tiny) == (4.0, 2, "")
    assert ask(tiny) == (4.0, 0, "")
    assert len(cache_folders(tmp_path / "user")) == 1


def test_with_no_place_for_a_cache_it_runs_and_says_so_in_one_sentence(tmp_path, tiny):
    (tmp_path / "site" / "tiny" / "__pycache__").write_text("")
    (tmp_path / "user").write_text("")
    for _ in range(2):
        value, n_compiled, said = ask(tiny)
        assert (value, n_compiled) == (4.0, 2)
        assert said.count("cannot keep its machine code") == 1
        assert said.startswith("tiny cannot keep its machine code (no folder for it can be written)")
        assert "NUMBA_CACHE_DIR" in said


def test_a_disk_that_is_full_costs_time_and_no_result(tiny):
    fails = (
        "import errno, numba.core.caching as caching\n"
        "def save(*_): raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "caching.IndexDataCacheFile.save = save\n"
    )
    value, n_compiled, said = ask(tiny, fails + ASK)
    assert (value, n_compiled) == (4.0, 2)
    assert said.count("cannot keep its machine code") == 1
    assert "No space left on device" in said


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_damaged_files_are_compiled_again(tmp_path, tiny, ending):
    tiny["NUMBA_CACHE_DIR"] = str(tmp_path / "kernels")
    ask(tiny)
    for path in (tmp_path / "kernels").rglob(f"*.{ending}"):
        path.write_bytes(path.read_bytes()[:10])
    value, n_compiled, said = ask(tiny)
    assert (value, said) == (4.0, "")
    assert n_compiled > 0
    assert ask(tiny)[:2] == (4.0, 0)


def test_machine_code_filed_under_another_variant_is_not_run(tmp_path, tiny):
    tiny["NUMBA_CACHE_DIR"] = str(tmp_path / "kernels")
    ask(tiny, "from tiny.callee import part\nprint(part(1.0), int(part(3)))")
    (first,) = (tmp_path / "kernels").rglob("tiny.callee.part*.1.nbc")
    second = first.with_name(first.name.replace(".1.nbc", ".2.nbc"))
    data = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(data)
    code = f"from tiny import _jit\nfrom tiny.callee import part\nprint(part(1.0), {N_COMPILED})"
    assert ask(tiny, code)[:2] == (2.0, 1)


def test_a_place_that_numba_is_told_of_is_not_taken(tmp_path, tiny):
    tiny |= {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "NUMBA_CACHE_LOCATOR_CLASSES": "InTreeCacheLocator"}
    assert ask(tiny)[:2] == (4.0, 2)
    assert ask(tiny)[:2] == (4.0, 0)
    assert list((tmp_path / "kernels").rglob("*.nbc"))
    assert not list((tmp_path / "site").rglob("*.nbc"))


@pytest.fixture
def brought(tmp_path, tiny):
    """Machine code for any processor, made elsewhere; and the environment of a process that finds version 1 here."""
    write_tiny(tmp_path / "elsewhere", 1.0)
    there = tiny | {"PYTHONPATH": str(tmp_path / "elsewhere"), "NUMBA_CACHE_DIR": str(tmp_path / "made")}
    assert ask(there | {"NUMBA_CPU_NAME": "generic"})[1] == 2
    return tmp_path / "made"


@pytest.mark.parametrize("way", ["NUMBA_CACHE_DIR", "package"])
def test_code_for_any_processor_is_loaded_wherever_the_package_is(tmp_path, tiny, brought, way):
    place = tmp_path / "site" / "tiny" / "_kernels" if way == "package" else tmp_path / "moved"
    brought.rename(place)
    if way == "NUMBA_CACHE_DIR":
        tiny["NUMBA_CACHE_DIR"] = str(place)
    for path in (tmp_path / "site" / "tiny").glob("*.py"):
        os.utime(path, (1e9, 1e9))  # installed at another time
    assert ask(tiny) == (4.0, 0, "")


def test_code_that_came_with_the_package_is_read_where_nothing_can_be_written(tmp_path, tiny, brought):
    brought.rename(tmp_path / "site" / "tiny" / "_kernels")
    (tmp_path / "site" / "tiny" / "__pycache__").write_text("")
    (tmp_path / "user").write_text("")
    assert ask(tiny) == (4.0, 0, "")


def test_code_for_this_processor_goes_before_code_for_any(tmp_path, tiny, brought):
    tiny["NUMBA_CACHE_DIR"] = str(tmp_path / "own")
    assert ask(tiny)[1] == 2
    shutil.copytree(brought, tmp_path / "site" / "tiny" / "_kernels")
    for path in (tmp_path / "site" / "tiny" / "_kernels").rglob("*.nbc"):
        path.write_bytes(b"damaged")
    assert ask(tiny) == (4.0, 0, "")


@pytest.mark.parametrize("what", ["version", "processor", "damaged", "Numba"])
def test_code_that_does_not_fit_is_passed_over_in_silence(tmp_path, tiny, brought, what):
    if what == "version":
        write_tiny(tmp_path / "site", 20.0)
    elif what == "processor":  # of another kind: what is compiled for a named one is not for any
        shutil.rmtree(brought)
        named = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(brought)}
        ask(tiny | named)
    else:
        for path in brought.rglob("*.nbc" if what == "damaged" else "*.nbi"):
            data = path.read_bytes()
            path.write_bytes(data[:10] if what == "damaged" else data.replace(numba.__version__.encode(), b"0" * 6))
    before = {path: path.read_bytes() for path in brought.rglob("*.nb?")}
    brought.rename(tmp_path / "site" / "tiny" / "_kernels")
    assert ask(tiny) == (42.0 if what == "version" else 4.0, 2, "")
    after = (tmp_path / "site" / "tiny" / "_kernels").rglob("*.nb?")
    assert {path.name: path.read_bytes() for path in after} == {path.name: data for path, data in before.items()}


def test_nobody_elses_kernels_are_moved(tmp_path, tiny):
    tiny["NUMBA_CACHE_DIR"] = str(tmp_path / "kernels")
    (tmp_path / "site" / "theirs.py").write_text("import numba\n@numba.njit(cache=True)\ndef f(x):\n    return x\n")
    code = "import numba, theirs\nprint(theirs.f(1.0), 'tiny-kernels' in theirs.f.stats.cache_path)"
    before = "from tiny import callee\n"
    done = subprocess.run([sys.executable, "-c", before + code], env=tiny, capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["1.0", "False"]


def test_folders_of_other_versions_are_swept_when_unused_for_a_day(tmp_path, tiny):
    kernels = tmp_path / "kernels"
    tiny["NUMBA_CACHE_DIR"] = str(kernels)
    ages_h = {"tiny-kernels-0123456789abcdef": 25.0, "tiny-kernels-fedcba9876543210": 23.0}
    ages_h |= {"curvescan-kernels-0123456789abcdef": 25.0, "tiny-kernels-of-mine": 25.0}
    for name, age_h in ages_h.items():
        (kernels / name / "inside").mkdir(parents=True)
        then = time.time() - 3600.0 * age_h
        os.utime(kernels / name, (then, then))
    ask(tiny)
    left = {path.name for path in kernels.iterdir()}
    assert ages_h.keys() - left == {"tiny-kernels-0123456789abcdef"}
    assert len(left) == 4


def test_code_that_is_found_loads_no_part_of_the_compiler(tiny):
    """Numba's own way of loading takes in all it can compile, and SciPy with it: half a second of processor."""
    compiler = "numba.np.linalg"
    ask(tiny, ASK + f"assert {compiler!r} in sys.modules\n")
    assert ask(tiny, ASK + f"assert {compiler!r} not in sys.modules\n")[1] == 0


def test_every_kernel_of_the_package_is_cached_under_the_digest():
    for name in kernel_modules():
        importlib.import_module(name)
    folder = _kernel_cache.cache_folder()
    assert folder is not None
    assert len(_jit._kernels) > 40
    for kernel in _jit._kernels:
        assert Path(kernel.stats.cache_path) == folder
        assert isinstance(kernel._cache, _kernel_cache.KernelCache)
    assert os.environ.get("NUMBA_CACHE_DIR", "") == numba.config.CACHE_DIR


def test_the_digest_covers_whatever_a_kernel_can_depend_on(tmp_path):
    """An edit of any module that is loaded with the kernels changes it."""
    code = f"import {', '.join(kernel_modules())}, sys\nprint(*(m for m in sys.modules if m.startswith('curvescan')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    # the facade loads its names on use, and the version is a word for people
    loaded = set(done.stdout.split()) - {"curvescan", "curvescan._version"}
    root = tmp_path / "curvescan"
    shutil.copytree(SOURCE, root, ignore=shutil.ignore_patterns("__pycache__"))
    before = _kernel_cache.source_digest(root)
    unnoticed = set()
    for name in loaded:
        path = root.parent.joinpath(*name.split("."))
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        text = path.read_bytes()
        path.write_bytes(text + b"# edited\n")
        if _kernel_cache.source_digest(root) == before:
            unnoticed.add(name)
        path.write_bytes(text)
    assert len(loaded) > 40
    assert not unnoticed


def test_the_digest_follows_the_sources_it_covers(tmp_path, monkeypatch):
    write_tiny(tmp_path, 1.0)
    monkeypatch.syspath_prepend(tmp_path)
    source_digest = importlib.import_module("tiny._kernel_cache").source_digest
    for name in ("tiny", "tiny._kernel_cache"):
        monkeypatch.delitem(sys.modules, name)
    (tmp_path / "tiny" / "cli").mkdir()
    (tmp_path / "tiny" / "cli" / "main.py").write_text("a = 1\n")
    before = source_digest(tmp_path / "tiny")
    (tmp_path / "tiny" / "cli" / "main.py").write_text("a = 2\n")
    assert source_digest(tmp_path / "tiny") == before
    (tmp_path / "tiny" / "callee.py").write_text(CALLEE.format(number=2.0))
    changed = source_digest(tmp_path / "tiny")
    assert changed != before
    (tmp_path / "tiny" / "callee.py").rename(tmp_path / "tiny" / "renamed.py")
    assert source_digest(tmp_path / "tiny") not in (before, changed, None)
    assert source_digest(tmp_path / "missing") is None
