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
_STORED_BYTES = 13
"""Bytes of a voxel that a device keeps: three temperatures and its degree."""


class Machine(NamedTuple):
    """A device and the network between its like."""

    name: str
    bandwidth: float
    """Bandwidth of its memory [B/s]."""
    memory: float
    """Size of its memory [B]."""
    network: float
    """Bandwidth into and out of each device [B/s]."""
    latency: float
    """Time before the first byte of a message arrives [s]."""

    def interior_time(self, voxels: float, devices: float | int) -> float:
        """Time of a step without its neighbours' planes [s]."""
        return STEP_BYTES * voxels / (devices * self.bandwidth)

    def halo_time(self, voxels: float) -> float:
        """Time to send the planes of a section to both neighbours [s]."""
        return 8 * voxels ** (2 / 3) / self.network + self.latency

    def useful_devices(self, voxels: float) -> float:
        """Number of devices from which the planes take as long as the interior."""
        return self.interior_time(voxels, 1) / self.halo_time(voxels)

    def fewest_devices(self, voxels: float) -> int:
        """Number of devices whose memory holds the body."""
        return max(1, int(-(-_STORED_BYTES * voxels // (0.9 * self.memory))))

    def block_time(self, voxels: float, devices: float | int) -> float:
        """Time to send the six faces of a block in place of a section [s]."""
        return 24 * (voxels / devices) ** (2 / 3) / self.network + self.latency


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


_SIZES = (1e9, 1e12)
"""Numbers of voxels."""

_MACHINES = (
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


def on_paper() -> list[PaperRow]:
    """Rows for each size and machine, on the fewest devices and on the most useful."""
    rows: list[PaperRow] = []
    for voxels in _SIZES:
        for machine in _MACHINES:
            fewest = machine.fewest_devices(voxels)
            useful = max(fewest, int(machine.useful_devices(voxels)))
            halo = machine.halo_time(voxels)
            rows.append(
                {
                    "voxels": voxels,
                    "machine": machine.name,
                    "fewest": fewest,
                    "step_on_fewest_s": max(
                        machine.interior_time(voxels, fewest),
                        halo if fewest > 1 else 0.0,
                    ),
                    "useful": useful,
                    "step_on_useful_s": max(
                        machine.interior_time(voxels, useful),
                        halo if useful > 1 else 0.0,
                    ),
                    "planes_s": halo,
                    "blocks_s": machine.block_time(voxels, useful),
                }
            )
    return rows
