"""Build step: a wheel carries SPEC.md, from which the conformance suite reads the clauses."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

SPEC = "protocol/SPEC.md"


class BuildWithSpec(build_py):
    """Copies SPEC.md into ``haptogram_protocol``; an editable install reads or links the source."""

    def run(self) -> None:
        """Build the packages, and add SPEC.md."""
        super().run()
        if not self.editable_mode:
            self.copy_file(SPEC, self._packed_spec())

    def _packed_spec(self) -> str:
        return str(Path(self.build_lib, "haptogram_protocol", "SPEC.md"))

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Return the files that the build makes, SPEC.md among them."""
        return [*super().get_outputs(include_bytecode), self._packed_spec()]

    def get_output_mapping(self) -> dict[str, str]:
        """Return the source of every file that the build copies or links."""
        return {**super().get_output_mapping(), self._packed_spec(): SPEC}

    def get_source_files(self) -> list[str]:
        """Return the files that a source distribution needs, SPEC.md among them."""
        return [*super().get_source_files(), SPEC]


setup(cmdclass={"build_py": BuildWithSpec})
