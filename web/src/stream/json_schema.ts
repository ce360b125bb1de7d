/** Checks values from JSON against a schema: the keywords of docs/stream.schema.json (web/schema.mjs refuses others). */

import { StreamError } from "./errors.ts";

export interface Schema {
  readonly $ref?: string;
  readonly type?: "object" | "array" | "string" | "number" | "integer" | "boolean" | "null";
  readonly const?: string | number;
  readonly enum?: readonly unknown[];
  readonly pattern?: string;
  readonly minimum?: number;
  readonly maximum?: number;
  readonly exclusiveMinimum?: number;
  readonly exclusiveMaximum?: number;
  readonly items?: Schema;
  readonly prefixItems?: readonly Schema[];
  readonly minItems?: number;
  readonly maxItems?: number;
  readonly properties?: Readonly<Record<string, Schema>>;
  readonly required?: readonly string[];
  readonly default?: unknown;
  readonly anyOf?: readonly Schema[];
  readonly oneOf?: readonly Schema[];
}

export type Definitions = Readonly<Record<string, Schema>>;

/** The error for a value; `place` is its position in the file. */
export function wrong(place: string, what: string, value: unknown = null): StreamError {
  const found = value === null ? "" : `; found ${JSON.stringify(value).slice(0, 80)}`;
  return new StreamError(`The stream's manifest is damaged: ${place} ${what}${found}.`);
}

const inside = (place: string, key: string | number): string => (place === "" ? String(key) : `${place}.${key}`);

/** Checks a value, and puts defaults where properties with a default are missing. `place`: its position in the file, for
 * messages. StreamError: it does not conform. */
export function check(value: unknown, schema: Schema, definitions: Definitions, place: string): void {
  const { $ref, anyOf, oneOf } = schema;
  const options = anyOf ?? oneOf;
  if ($ref !== undefined) check(value, definitions[$ref.slice("#/$defs/".length)], definitions, place);
  else if (options !== undefined) check(value, closest(value, options, definitions), definitions, place);
  else if (schema.const !== undefined && value !== schema.const) throw wrong(place, `must be ${schema.const}`, value);
  else if (schema.enum !== undefined && !schema.enum.includes(value)) throw wrong(place, `must be ${schema.enum.join(" or ")}`, value);
  else if (schema.type === "object") checkObject(value, schema, definitions, place);
  else if (schema.type === "array") checkArray(value, schema, definitions, place);
  else if (schema.type === "number" || schema.type === "integer") checkNumber(value, schema, place);
  else if (schema.type === "null" ? value !== null : typeof value !== schema.type) throw wrong(place, "is not valid", value);
  else if (schema.pattern !== undefined && !new RegExp(schema.pattern).test(value as string)) throw wrong(place, "is not valid", value);
}

/** The alternative that a value is meant to be: the one of which the fewest properties are missing. */
function closest(value: unknown, options: readonly Schema[], definitions: Definitions): Schema {
  const missing = (option: Schema): number => {
    const { type, required = [] } = option.$ref === undefined ? option : definitions[option.$ref.slice("#/$defs/".length)];
    if ((type === "null") !== (value === null)) return Infinity;
    return required.filter((key) => !Object.hasOwn(Object(value) as object, key)).length;
  };
  return options.reduce((best, option) => (missing(option) < missing(best) ? option : best));
}

function checkObject(value: unknown, schema: Schema, definitions: Definitions, place: string): void {
  if (typeof value !== "object" || value === null || Array.isArray(value)) throw wrong(place, "is not an object", value);
  const values = value as Record<string, unknown>;
  for (const key of schema.required ?? [])
    if (!Object.hasOwn(values, key)) throw wrong(inside(place, key), "is missing");
  for (const [key, property] of Object.entries(schema.properties ?? {})) {
    if (Object.hasOwn(values, key)) check(values[key], property, definitions, inside(place, key));
    else if (property.default !== undefined) values[key] = property.default;
  }
}

function checkArray(value: unknown, schema: Schema, definitions: Definitions, place: string): void {
  const { minItems = 0, maxItems = Infinity, prefixItems, items } = schema;
  if (!Array.isArray(value) || value.length < minItems || value.length > maxItems)
    throw wrong(place, `must be a list of ${minItems} to ${maxItems} entries`, value);
  value.forEach((item, i) => {
    const own = prefixItems?.[i] ?? items;
    if (own !== undefined) check(item, own, definitions, inside(place, i));
  });
}

function checkNumber(value: unknown, schema: Schema, place: string): void {
  const { minimum = -Infinity, maximum = Infinity, exclusiveMinimum = -Infinity, exclusiveMaximum = Infinity } = schema;
  const fits = schema.type === "integer" ? Number.isSafeInteger(value) : Number.isFinite(value);
  const number = value as number;
  if (fits && number >= minimum && number <= maximum && number > exclusiveMinimum && number < exclusiveMaximum) return;
  const bounds = [
    minimum > -Infinity ? ` of at least ${minimum}` : exclusiveMinimum > -Infinity ? ` above ${exclusiveMinimum}` : "",
    maximum < Infinity ? ` up to ${maximum}` : exclusiveMaximum < Infinity ? ` below ${exclusiveMaximum}` : "",
  ];
  throw wrong(place, `must be ${schema.type === "integer" ? "an integer" : "a number"}${bounds.join("")}`, value);
}
