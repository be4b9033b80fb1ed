"""The numeric packages from their source: public classes and functions with signatures and docstrings."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGES = {
    "dynamics": "forces, moments, axes",
    "recordings": "files of a gait laboratory",
    "body": "segments and the geometric centre of mass",
    "estimation": "the centre of mass from geometry and force",
    "walking": "steps, the rolling wheel, many people",
    "robots": "cards, models, collisions",
    "contacts": "scenarios, cones, the contact planner",
    "reachability": "where the centre of mass can be",
    "centroidal": "the motion of the centre of mass",
    "wholebody": "joints, torques, certificate, replay",
}


def public(name: str) -> bool:
    """Whether others may use it."""
    return not name.startswith("_")


def docstring(node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Its docstring as Markdown."""
    text = (ast.get_docstring(node) or "").replace("``", "`")
    return [text, ""] if text else []


def signature(function: ast.FunctionDef | ast.AsyncFunctionDef, *, method: bool) -> str:
    """As it stands in the source, without ``self``; a property is written as the attribute that it looks like."""
    back = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    if {ast.unparse(d) for d in function.decorator_list} & {"property", "cached_property"}:
        return f"{function.name}{back.replace(' -> ', ': ')}"
    arguments = function.args
    if method and arguments.args and arguments.args[0].arg in {"self", "cls"}:
        arguments = ast.arguments(**{**vars(arguments), "args": arguments.args[1:]})
    return f"{function.name}({ast.unparse(arguments)}){back}"


def fields(class_: ast.ClassDef) -> list[str]:
    """The annotated fields of a class, one line each."""
    return [
        ast.unparse(node)
        for node in class_.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and public(node.target.id)
    ]


def members(class_: ast.ClassDef) -> Iterator[str]:
    """Public methods of a class with a docstring of their own."""
    for node in class_.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and public(node.name) and ast.get_docstring(node):
            yield from ["```python", signature(node, method=True), "```", "", *docstring(node)]


def module_lines(name: str, tree: ast.Module) -> list[str]:
    """One module: its idea, then what is public in it."""
    lines = [f"## {name}", "", *docstring(tree)]
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and public(node.name):
            bases = f"({', '.join(ast.unparse(b) for b in node.bases)})" if node.bases else ""
            shown = [f"class {node.name}{bases}", *(f"    {field}" for field in fields(node))]
            lines += [f"### {node.name}", "", "```python", *shown, "```", "", *docstring(node), *members(node)]
        elif isinstance(node, ast.FunctionDef) and public(node.name):
            lines += [f"### {node.name}", "", "```python", signature(node, method=False), "```", "", *docstring(node)]
    return lines


def package_page(root: Path, package: str) -> str:
    """All modules of a package."""
    folder = root / "backend" / "stridelab" / package
    lines = [f"# {package}: {PACKAGES[package]}", "", f"Public names of `stridelab.{package}`, from the source.", ""]
    for path in sorted(folder.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if public(path.stem) and path.stem != "__init__":
            name = ".".join(path.relative_to(folder.parent).with_suffix("").parts)
            lines += module_lines(name, tree)
    return "\n".join(lines)
