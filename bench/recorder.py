"""A device that remembers what was launched."""

from typing import Any

from gpubspline.device import Buffer, Device


class Recorder:
    """Passes everything on to a device and keeps its launches, to be repeated on the buffers they were made with.

    So the library's own functions decide which kernels run and over what, and transfers and allocation stay out of the
    time that ``replay`` takes.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._launches: list[tuple[Any, ...]] = []
        self.backend, self.name, self.label, self.real = device.backend, device.name, device.label, device.real
        self.cores, self.on_build = device.cores, device.on_build

    def put(self, array: Any) -> Buffer:
        return self._device.put(array)

    def empty(self, shape: int | tuple[int, ...], dtype: Any = None) -> Buffer:
        return self._device.empty(shape, dtype)

    def get(self, buffer: Buffer) -> Any:
        return self._device.get(buffer)

    def copy(self, source: Buffer, target: Buffer) -> None:
        self._device.copy(source, target)

    def launch(self, kernel: str, dim: int | tuple[int, ...], *args: Any) -> None:
        self._launches.append((kernel, dim, *args))
        self._device.launch(kernel, dim, *args)

    def wait(self) -> None:
        self._device.wait()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def replay(self) -> None:
        """Launch everything again, in order, and wait for it."""
        for arguments in self._launches:
            self._device.launch(*arguments)
        self._device.wait()
