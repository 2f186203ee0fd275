"""What the router's log says of refusals, from lines as the installed Zenoh writes them."""

import pytest

from sumo_dist.wire.audit import Audit

AT = "\x1b[2m2026-11-27T00:42:55.5Z\x1b[0m "
ZID = "4943e7e6bbcc5d8ff7883863895936f4"
ACL = "ThreadId(08) zenoh::net::routing::interceptor::access_control: "
ACCEPTED = (
    "DEBUG acc-0 ThreadId(05) zenoh_link_tls::unicast: Accepted TLS connection on "
    "127.0.0.1:7931: 192.0.2.7:34572. Common Name: worker.3."
)
OPENED = (
    "DEBUG acc-0 ThreadId(06) zenoh_transport::unicast::establishment::accept: New transport link "
    f"accepted from {ZID} to 77c6: TransportLinkUnicast {{ link: Link {{ src: tls/127.0.0.1:7931, "
    "dst: tls/192.0.2.7:34572, mtu: 49152 } }"
)
WHO = f"{ZID} on Interface(lo)+CertCommonName(worker.3)+Transport(Tls)+{ZID} is unauthorized to "
LISTING = f"TRACE  rx-0 {ACL}ACL (ingress): caching permissions for `sumo/v6/spot/plan` ..."
LISTED = [
    f"TRACE  rx-0 {ACL}{WHO}{what} (ingress) on sumo/v6/spot/plan"
    for what in ("Query", "Reply", "Put", "Delete", "Declare/Undeclare Subscriber")
]
CACHED = (
    f"TRACE  rx-0 {ACL}Using cached result: {ZID} is unauthorized to Put (ingress) on "
    "sumo/v6/spot/plan"
)
DIRECT = f"TRACE  rx-1 {ACL}{WHO}Put (ingress) on sumo/v6/spot/plan"
LINE = "refused worker.3 from 192.0.2.7:34572: put on sumo/v6/spot/plan (told once)"


@pytest.fixture
def said(caplog):
    def said(*lines):
        audit = Audit()
        for line in lines:
            audit.take((AT + line).encode())
        return [record.message for record in caplog.records]

    return said


@pytest.mark.parametrize("refusal", [CACHED, DIRECT])
def test_a_refusal_is_told_once_with_its_certificate_address_and_key(said, refusal):
    assert said(ACCEPTED, OPENED, refusal, refusal) == [LINE]


def test_what_might_be_refused_is_not_told(said):
    assert said(ACCEPTED, OPENED, LISTING, *LISTED) == []


def test_what_is_refused_after_it_was_listed_is(said):
    assert said(ACCEPTED, OPENED, LISTING, *LISTED, LISTED[2]) == [LINE]
    assert said(ACCEPTED, OPENED, LISTING, *LISTED, DIRECT) == [LINE, LINE]  # of another thread


def test_what_is_allowed_or_not_sent_on_is_not_told(said):
    allowed = CACHED.replace("unauthorized", "authorized")
    assert said(ACCEPTED, OPENED, allowed, CACHED.replace("ingress", "egress")) == []


def test_a_failed_handshake_is_told_without_a_source_and_a_mere_look_is_not(said):
    failed = (
        "WARN acc-0 ThreadId(06) zenoh_link_tls::unicast: invalid peer certificate: UnknownIssuer. "
        "Hint: increase the system open file limit."
    )
    look = failed.replace("invalid peer certificate: UnknownIssuer", "tls handshake eof")
    assert said(failed, failed, look) == [
        "refused a connection, whose source Zenoh does not tell: invalid peer certificate: "
        "UnknownIssuer (told once)"
    ]


def test_a_certificate_that_has_expired_is_told_once_however_long_it_dials(said):
    failed = (
        "WARN acc-0 ThreadId(06) zenoh_link_tls::unicast: invalid peer certificate: certificate "
        "expired: verification time 1795753{} (UNIX), but certificate is not valid after "
        "1795753004 ({} seconds ago). Hint: increase the system open file limit."
    )
    (line,) = said(*(failed.format(14 + i, 10 + i) for i in range(3)))
    assert "certificate expired: verification time 179575314" in line
    other = failed.replace("certificate expired", "certificate not valid yet")
    assert len(said(failed.format(14, 10), other.format(14, 10))) == 3  # with the one before


@pytest.mark.parametrize("line", ["", "\xff\xfe", "is unauthorized to", "Accepted TLS connection"])
def test_any_other_line_is_left_alone(said, line):
    assert said(line) == []


def test_it_remembers_no_more_than_it_should(said):
    audit = Audit()
    for i in range(3000):
        audit.take(CACHED.replace("spot", f"r{i}").encode())
    assert len(audit._told) == 1000
