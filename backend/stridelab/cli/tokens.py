"""``stridelab token create|list|revoke``: works on the service's database, while the service runs and while not."""

import json
from collections.abc import Awaitable, Callable
from typing import Annotated, Any, TypeVar

import typer

from stridelab.cli.results import err, out
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.access import TokenScope

T = TypeVar("T")

tokens = typer.Typer(name="token", help="Tokens for users and scripts.", no_args_is_help=True)


@tokens.command()
def create(
    name: Annotated[str, typer.Argument(help="Name of the user; may be a pseudonym.")],
    scope: Annotated[TokenScope, typer.Option("--scope", help="read, submit or admin.")] = "submit",
    days: Annotated[
        float | None, typer.Option("--days", help="Days until it expires; by default valid until revoked.")
    ] = None,
) -> None:
    """Create a token and print it; it is shown only once."""
    from pydantic import ValidationError

    from stridelab.schemas.access import TokenInput
    from stridelab.service.auth import audit
    from stridelab.service.auth import tokens as table

    try:
        wanted = TokenInput(name=name, scope=scope, days=days)
    except ValidationError as error:
        faults = [Fault(".".join(map(str, e["loc"])), e["msg"]) for e in error.errors()]
        raise InvalidInput("invalid-token", "The fields of the token are invalid.", faults) from error

    async def insert_token(connection: Any) -> str:
        made = await table.create_token(connection, wanted)
        await audit.record_action(connection, audit.CONSOLE, "token-created", made.id)
        return made.secret

    secret = _in_transaction(insert_token)
    err.print(f"token of {name}, scope {scope}; it is not shown again:")
    typer.echo(secret)


@tokens.command(name="list")
def list_tokens(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, including revoked tokens.")] = False,
) -> None:
    """List tokens, without their secrets."""
    from stridelab.service.auth import tokens as table

    async def read_tokens(connection: Any) -> list[Any]:
        return await table.all_tokens(connection)

    listed = _in_transaction(read_tokens)
    if as_json:
        typer.echo(json.dumps([one.model_dump(mode="json") for one in listed]))
        return
    for one in listed:
        if one.revoked_at is None:
            until = f"until {one.expires_at:%Y-%m-%d %H:%M}" if one.expires_at else "until revoked"
            out.print(f"{one.name}  {one.scope}  {until}  {one.id}")


@tokens.command()
def revoke(name: Annotated[str, typer.Argument(help="Name or id of the token.")]) -> None:
    """Revoke a token; running services refuse it within two seconds."""
    from stridelab.service.auth import audit
    from stridelab.service.auth import tokens as table

    async def revoke_token(connection: Any) -> None:
        revoked = await table.revoke_token(connection, name)
        await audit.record_action(connection, audit.CONSOLE, "token-revoked", revoked.id)

    _in_transaction(revoke_token)
    out.print(f"{name} is revoked")


def _in_transaction(work: Callable[[Any], Awaitable[T]]) -> T:
    """Run ``work`` in one transaction of the service's database, after updating its tables."""
    from stridelab.cli.serve import read_settings
    from stridelab.service.backup.locations import open_location
    from stridelab.service.logging import configure_logging
    from stridelab.service.storage.database import make_engine
    from stridelab.service.storage.migrate import migrate

    async def run_work(url: str) -> T:
        engine = make_engine(url, pool_size=1)
        try:
            async with engine.begin() as connection:
                return await work(connection)
        finally:
            await engine.dispose()

    configure_logging("warning")  # the audit table has what was done; standard output is for the token
    with open_location(read_settings(), require_stopped=False, create=True) as location:
        migrate(location.database_url)
        import asyncio

        return asyncio.run(run_work(location.database_url))
