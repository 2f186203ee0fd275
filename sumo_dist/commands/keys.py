"""`sumo-dist keys`: an authority of one's own, and a certificate for each host and role."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.authority.certificates import ROLES, checked_address
from sumo_dist.authority.folder import SOON_DAYS
from sumo_dist.authority.store import REVOKED, Authority, home_of
from sumo_dist.errors import UsageError, unknown

DAYS = 90.0
_HOST = r"[A-Za-z0-9]([A-Za-z0-9.-]{0,48}[A-Za-z0-9])?"


@dataclass(frozen=True)
class InitOptions:
    """Options of `keys init`.

    Attributes:
        home: folder of keys; by default $SUMO_DIST_KEYS, else ~/.config/sumo-dist/keys.
    """

    home: Path | None = None


@dataclass(frozen=True)
class HostOptions:
    """Options of `keys host`.

    Attributes:
        host: its name; also a name by which a router there may be dialled.
        role: what it does, one or several of router, robot, optimizer, worker, tracer, operator,
            with commas between them; robot is for robot-interface and its state-estimator.
        address: IP addresses and DNS names by which the others dial a router there.
        days: until the certificates expire.
        home: folder of keys; by default $SUMO_DIST_KEYS, else ~/.config/sumo-dist/keys.
    """

    host: Annotated[str, tyro.conf.Positional]
    role: str
    address: tuple[str, ...] = ()
    days: float = DAYS
    home: Path | None = None

    def __post_init__(self) -> None:
        _checked_host(self.host)
        _checked_days(self.days)
        for address in self.address:
            checked_address(address)


@dataclass(frozen=True)
class RenewOptions:
    """Options of `keys renew`.

    Attributes:
        host: its name.
        days: until the new certificates expire.
        home: folder of keys; by default $SUMO_DIST_KEYS, else ~/.config/sumo-dist/keys.
    """

    host: Annotated[str, tyro.conf.Positional]
    days: float = DAYS
    home: Path | None = None

    def __post_init__(self) -> None:
        _checked_host(self.host)
        _checked_days(self.days)


@dataclass(frozen=True)
class RevokeOptions:
    """Options of `keys revoke`.

    Attributes:
        host: its name.
        role: only these of its roles, with commas between them; by default all.
        home: folder of keys; by default $SUMO_DIST_KEYS, else ~/.config/sumo-dist/keys.
    """

    host: Annotated[str, tyro.conf.Positional]
    role: str = ""
    home: Path | None = None

    def __post_init__(self) -> None:
        _checked_host(self.host)


@dataclass(frozen=True)
class ShowOptions:
    """Options of `keys show`.

    Attributes:
        home: folder of keys; by default $SUMO_DIST_KEYS, else ~/.config/sumo-dist/keys.
    """

    home: Path | None = None


def init(options: InitOptions) -> int:
    """Make an authority."""
    authority = Authority.found(home_of(options.home))
    print(
        f"an authority in {authority.home}, until {authority.ca.expires:%Y-%m-%d}: its ca.key "
        "issues any role, so keep that folder on one machine"
    )
    return 0


def host(options: HostOptions) -> int:
    """Issue keys for a host."""
    authority = Authority(home_of(options.home))
    roles = _checked_roles(options.role)
    authority.host(options.host, roles, options.address, options.days)
    for role in roles:
        print(f"{authority.folder(options.host, role)}: copy it to {options.host}, for --keys")
    return 0


def renew(options: RenewOptions) -> int:
    """Prolong a host's certificates."""
    authority = Authority(home_of(options.home))
    for role in authority.renew(options.host, options.days):
        print(
            f"{authority.folder(options.host, role)}: copy its cert.pem to {options.host} and "
            f"start its {role} again"
        )
    return 0


def revoke(options: RevokeOptions) -> int:
    """End a host's certificates."""
    authority = Authority(home_of(options.home))
    roles = _checked_roles(options.role) if options.role else ()
    routers = authority.revoke(options.host, roles)
    for router in routers:
        path = authority.folder(router, "router") / REVOKED
        print(f"{path}: copy it to the router's folder on {router}, which reads it while it runs")
    if not routers:
        print("no router has keys of this authority, so none is to be told")
    return 0


def show(options: ShowOptions) -> int:
    """Print what was issued and until when it is good."""
    authority = Authority(home_of(options.home))
    print(f"authority in {authority.home}, until {authority.ca.expires:%Y-%m-%d}")
    for one in sorted(authority.issued(), key=lambda one: (one.host, one.role, one.number)):
        expires = datetime.fromisoformat(one.expires)
        named = f"  {', '.join(one.addresses)}" if one.addresses else ""
        print(
            f"  {one.host:<20}{one.role:<11}{one.name:<16}{expires:%Y-%m-%d %H:%M}  "
            f"{_state(one.revoked, expires)}{named}"
        )
    return 0


def _state(revoked: bool, expires: datetime) -> str:
    left = expires - datetime.now(UTC)
    if revoked:
        return "revoked"
    if left <= timedelta():
        return "expired"
    return f"{left.days} days left" + (", renew it" if left < timedelta(days=SOON_DAYS) else "")


def _checked_roles(text: str) -> list[str]:
    roles = list(dict.fromkeys(text.split(",")))
    for role in roles:
        if role not in ROLES:
            raise unknown("role", role, ROLES)
    return roles


def _checked_host(name: str) -> None:
    if not re.fullmatch(_HOST, name):
        raise UsageError(
            f"host {name!r} is not a valid name: up to 50 of A-Z a-z 0-9 . -, starting and ending "
            "with a letter or a digit"
        )


def _checked_days(days: float) -> None:
    if not 0 < days <= 3650:
        raise UsageError(f"days must be in (0, 3650], got {days:g}")
