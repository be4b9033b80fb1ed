// viser's own build takes its decoder of messages from the script that unpacks its page; there is no such script here.
import { ZSTDDecoder } from "zstddec";

export type ZstdDecoder = Pick<ZSTDDecoder, "decode">;

export async function createZstdDecoder(): Promise<ZstdDecoder> {
  const decoder = new ZSTDDecoder();
  await decoder.init();
  return decoder;
}
