"""The tables of the store."""

from __future__ import annotations

from sqlalchemy import BigInteger, Boolean, Float, ForeignKey, Index, Integer, LargeBinary, MetaData, String, Text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column


class Base(DeclarativeBase):
    """All tables; constraints have names, so that a migration can change them anywhere."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(column_0_label)s",
            "uq": "uq_%(table_name)s_%(column_0_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "pk": "pk_%(table_name)s",
        }
    )


class Trainee(Base):
    """Somebody who trains, without a name."""

    __tablename__ = "trainees"
    id: Mapped[int] = mapped_column(primary_key=True)
    pseudonym: Mapped[str] = mapped_column(String(64), unique=True)


class StoredAttempt(Base):
    """An attempt: what lists and curves need in columns, the whole assessment as compressed JSON."""

    __tablename__ = "attempts"
    id: Mapped[int] = mapped_column(primary_key=True)
    trainee_id: Mapped[int] = mapped_column(ForeignKey("trainees.id", ondelete="CASCADE"))
    key: Mapped[str] = mapped_column(String(64), unique=True)
    scenario: Mapped[str] = mapped_column(String(64))
    began_ns: Mapped[int] = mapped_column(BigInteger)
    outcome: Mapped[str] = mapped_column(String(16))
    counts: Mapped[bool] = mapped_column(Boolean)
    time_s: Mapped[float] = mapped_column(Float)
    total: Mapped[float | None] = mapped_column(Float)
    percent: Mapped[float | None] = mapped_column(Float)
    errors: Mapped[int] = mapped_column(Integer)
    critical: Mapped[int] = mapped_column(Integer)
    recording: Mapped[str] = mapped_column(String(4096))
    assessment: Mapped[bytes] = mapped_column(LargeBinary)

    __table_args__ = (Index("ix_attempts_trainee_id_began_ns", "trainee_id", "began_ns"), Index(None, "began_ns"))


class Note(Base):
    """What somebody says of a trainee, or of one of the attempts: a kind, and JSON that this kind has."""

    __tablename__ = "notes"
    id: Mapped[int] = mapped_column(primary_key=True)
    trainee_id: Mapped[int] = mapped_column(ForeignKey("trainees.id", ondelete="CASCADE"), index=True)
    attempt_id: Mapped[int | None] = mapped_column(ForeignKey("attempts.id", ondelete="CASCADE"), index=True)
    kind: Mapped[str] = mapped_column(String(16))
    by: Mapped[str] = mapped_column(String(64))
    at_ns: Mapped[int] = mapped_column(BigInteger)
    data: Mapped[str] = mapped_column(Text)
