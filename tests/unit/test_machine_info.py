"""What a measurement was made on: kind of core, vectors, caches."""

import platform

import numba
import pytest

from thirdbody.studies import machine_info


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names of x86 cores")
def test_code_is_named_with_its_vectors_and_caches_of_a_core_are_read(monkeypatch, tmp_path):
    for k, words in enumerate([("1", "Data", "48K", "0"), ("1", "Instruction", "32K", "0"), ("3", "Unified", "32768K", "0-3,8")]):
        (tmp_path / f"index{k}").mkdir()
        for name, word in zip(("level", "type", "size", "shared_cpu_list"), words, strict=True):
            (tmp_path / f"index{k}" / name).write_text(f"{word}\n")
    (tmp_path / "index3").mkdir()  # hidden by the system
    monkeypatch.setattr(machine_info, "CACHES", tmp_path)
    assert machine_info.caches() == {"L1": {"KiB": 48, "cores": 1}, "L3": {"KiB": 32768, "cores": 5}}
    report = {"cpu": "C", "core": "a", "code_for": "b", "vector_bits": 256, "caches": machine_info.caches()}
    assert machine_info.described(report) == "C (a, code for b, 256-bit vectors, L1 48 KiB, L3 32768 KiB)"
    for name, bits in (("x86-64", 128), ("haswell", 256), ("znver5", 512)):
        monkeypatch.setattr(numba.config, "CPU_NAME", name)
        found = machine_info.core()
        assert (found["code_for"], found["vector_bits"]) == (name, bits)
