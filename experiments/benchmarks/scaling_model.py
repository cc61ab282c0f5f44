"""Time of an explicit step over many devices, on paper.

    T = max(b n / (N B), 8 A / W + L),    A = n^(2/3)

for n voxels of b bytes to read and write on N devices of bandwidth B [B/s], cut into
sections that send two planes of A voxels of 4 B over a network of bandwidth W [B/s] and
latency L [s] while their interior is computed. Each section sends the same planes, so
that more devices than N* = b n^(1/3) W / (8 B) gain nothing; blocks in place of
sections would send 24 (n / N)^(2/3) bytes.
"""

from typing import NamedTuple, TypedDict


STEP_BYTES = 9
"""Bytes of a voxel that a step reads and writes: two temperatures and its degree."""
STORED_BYTES = 13
"""Bytes of a voxel that a device keeps: three temperatures and its degree."""


class Machine(NamedTuple):
    """A device and the network between its like."""

    name: str
    bandwidth: float
    """Bandwidth of its memory [B/s]."""
    memory: float
    """[B]"""
    network: float
    """Bandwidth into and out of each device [B/s]."""
    latency: float
    """[s]"""


class PaperRow(TypedDict):
    """Times of a step of a cube on one machine, and the devices that they are for."""

    voxels: float
    machine: str
    fewest: int
    step_on_fewest_s: float
    useful: int
    step_on_useful_s: float
    planes_s: float
    blocks_s: float


MACHINES = (
    Machine(
        name="GPU of 3.35 TB/s, links of 450 GB/s",
        bandwidth=3.35e12,
        memory=80e9,
        network=450e9,
        latency=5e-6,
    ),
    Machine(
        name="GPU of 3.35 TB/s, network of 25 GB/s",
        bandwidth=3.35e12,
        memory=80e9,
        network=25e9,
        latency=1e-5,
    ),
    Machine(
        name="CPU node of 300 GB/s, network of 25 GB/s",
        bandwidth=3e11,
        memory=5e11,
        network=25e9,
        latency=1e-5,
    ),
)


def interior_time(voxels: float, devices: float | int, machine: Machine) -> float:
    """Time of a step without its neighbours' planes [s]."""
    return STEP_BYTES * voxels / (devices * machine.bandwidth)


def halo_time(voxels: float, machine: Machine) -> float:
    """Time to send the planes of a section to both neighbours [s]."""
    return 8 * voxels ** (2 / 3) / machine.network + machine.latency


def useful_devices(voxels: float, machine: Machine) -> float:
    """Number of devices from which the planes take as long as the interior."""
    return interior_time(voxels, 1, machine) / halo_time(voxels, machine)


def fewest_devices(voxels: float, machine: Machine) -> int:
    """Number of devices whose memory holds the body."""
    return max(1, int(-(-STORED_BYTES * voxels // (0.9 * machine.memory))))


def block_time(voxels: float, devices: float | int, machine: Machine) -> float:
    """Time to send the six faces of a block in place of a section [s]."""
    return 24 * (voxels / devices) ** (2 / 3) / machine.network + machine.latency


def on_paper(sizes: tuple[float, ...] = (1e9, 1e12)) -> list[PaperRow]:
    """Rows for each size and machine, on the fewest devices and on the most useful."""
    rows: list[PaperRow] = []
    for voxels in sizes:
        for machine in MACHINES:
            fewest = fewest_devices(voxels, machine)
            useful = max(fewest, int(useful_devices(voxels, machine)))
            halo = halo_time(voxels, machine)
            rows.append(
                {
                    "voxels": voxels,
                    "machine": machine.name,
                    "fewest": fewest,
                    "step_on_fewest_s": max(
                        interior_time(voxels, fewest, machine),
                        halo if fewest > 1 else 0.0,
                    ),
                    "useful": useful,
                    "step_on_useful_s": max(
                        interior_time(voxels, useful, machine),
                        halo if useful > 1 else 0.0,
                    ),
                    "planes_s": halo,
                    "blocks_s": block_time(voxels, useful, machine),
                }
            )
    return rows
