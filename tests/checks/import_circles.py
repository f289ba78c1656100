"""Fail when modules of the package import each other in a circle, at the top or inside functions."""

import graphlib
import sys

import grimp


def main() -> int:
    graph = grimp.build_graph("gtf_tune", exclude_type_checking_imports=True, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        circle = " imports ".join(reversed(error.args[1]))
        sys.stderr.write(f"an import circle: {circle}; move what they share into a module that both import\n")
        return 1
    return 0 if imports else 1


if __name__ == "__main__":
    sys.exit(main())
