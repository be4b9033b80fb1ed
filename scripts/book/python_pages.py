"""The numeric packages from their source: public classes and functions with signatures and docstrings."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGES = {
    "library": "the front, `import stridelab as sl`",
    "dynamics": "forces, moments, axes",
    "recordings": "files of a gait laboratory",
    "body": "segments and the geometric centre of mass",
    "estimation": "the centre of mass from geometry and force",
    "walking": "steps, the rolling wheel, many people",
    "measures": "margins of stability, steps, work, energy, angular momentum",
    "robots": "cards, models, collisions",
    "contacts": "scenarios, cones, the contact planner",
    "reachability": "where the centre of mass can be",
    "centroidal": "the motion of the centre of mass",
    "wholebody": "joints, torques, certificate, replay",
    "simulation": "people and robots with known ground truth",
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


@cache
def statements(path: Path) -> list[ast.stmt]:
    """Statements of a file, which several packages may export from."""
    return ast.parse(path.read_text(encoding="utf-8")).body


def definitions(stub: Path) -> dict[str, tuple[Path, ast.stmt, str]]:
    """Names that a package exports by its stub: their module, their statement, and the docstring of a constant."""
    exported = {}
    for line in statements(stub):
        if isinstance(line, ast.ImportFrom) and line.level == 1 and line.module:
            base = stub.parent.joinpath(*line.module.split("."))
            path = base.with_suffix(".py") if base.with_suffix(".py").is_file() else base / "__init__.py"
            imported = {alias.name for alias in line.names}
            body = statements(path)
            for node, after in zip(body, [*body[1:], None], strict=True):
                names = {node.name} if isinstance(node, ast.ClassDef | ast.FunctionDef) else assigned(node)
                for name in names & imported:
                    exported[name] = (path, node, constant_docstring(after))
    return exported


def assigned(node: ast.stmt) -> set[str]:
    """Names that an assignment binds."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {target.id for target in targets if isinstance(target, ast.Name)}


def constant_docstring(after: ast.stmt | None) -> str:
    """The string below an assignment."""
    if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
        return after.value.value.replace("``", "`")
    return ""


def definition_lines(name: str, node: ast.stmt, constant: str) -> list[str]:
    """One public name: its signature and what its docstring says."""
    if isinstance(node, ast.ClassDef):
        bases = f"({', '.join(ast.unparse(b) for b in node.bases)})" if node.bases else ""
        lines = [f"class {name}{bases}", *(f"    {field}" for field in fields(node))]
        return [f"## {name}", "", "```python", *lines, "```", "", *docstring(node), *members(node)]
    if isinstance(node, ast.FunctionDef):
        return [f"## {name}", "", "```python", signature(node, method=False), "```", "", *docstring(node)]
    return [f"## {name}", "", "```python", ast.unparse(node), "```", "", constant, ""]


def package_page(root: Path, package: str) -> str:
    """Exactly the names that a package exports; ``library`` is the package ``stridelab`` itself."""
    folder = root / "backend" / "stridelab"
    folder = folder if package == "library" else folder / package
    module = "stridelab" if package == "library" else f"stridelab.{package}"
    lines = [f"# {package}: {PACKAGES[package]}", "", f"`from {module} import ...`; modules behind it may move.", ""]
    for name, (_, node, constant) in sorted(definitions(folder / "__init__.pyi").items()):
        lines += definition_lines(name, node, constant)
    return "\n".join(lines)
